"""Evaluation of candidates behind one interface: in this process, or on the actors of a local or distributed Ray."""
