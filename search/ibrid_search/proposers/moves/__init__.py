"""The edits an engineer would try, by family: whole sub-loops, single components, wires and shared parameters."""
