"""Whoever has the ideas: rules, chance, language models and agents, behind the interface of `ibrid_search.proposal`.

From outside: `choose` (from a name to a proposer), `rules`, `pruning`.
"""
