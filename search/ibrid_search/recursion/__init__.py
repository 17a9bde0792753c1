"""The recursion: a parent, a proposal, a judgement, a fit, an entry; who is asked, what it costs, who watches.

From outside: `loop`; `ibrid_search.running` puts a whole search together.
"""
