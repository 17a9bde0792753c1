"""The recursion: a parent, a proposal, a fit, an entry in the archive; who is asked, and who
watches.

From outside of `ibrid_search`: `progress`, `suggesting`.
"""
