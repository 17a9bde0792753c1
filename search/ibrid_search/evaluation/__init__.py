"""Evaluation of candidates behind one interface: in this process, or on the actors of a local or distributed Ray.

From outside: `judging` (from a proposal to a candidate), `assess`, `job`, and the evaluators `local`, `processes`, `ray_actors`.
"""
