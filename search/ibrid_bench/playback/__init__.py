"""Playback of records: what it costs, and which twins records tell apart."""
