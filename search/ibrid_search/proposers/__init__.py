"""Whoever has the ideas: rules, chance, language models and agents, behind the interface of `ibrid_search.proposal`."""
