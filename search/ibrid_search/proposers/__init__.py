"""Whoever has the ideas: rules, chance, language models and agents, behind the interface of
`ibrid_search.proposal`.

From outside of `ibrid_search`: `choose`, `diagnosis`, `first_look`, `language_model`,
`local_model`.
"""
