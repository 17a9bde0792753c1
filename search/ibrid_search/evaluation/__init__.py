"""Evaluation of candidates behind one interface: in this process, in others of this machine, or on
actors of Ray.

From outside of `ibrid_search`: `judging`, `ray_session`.
"""
