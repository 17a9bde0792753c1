"""Marks behind values in a block diagram that are not to be relied on, and what they mean."""

#: The data do not tell the value; it lies at an end of its box.
OPEN, AT_BOUND = "?", "!"
MARKS = {OPEN: "the data do not tell this value", AT_BOUND: "at an end of its box"}
