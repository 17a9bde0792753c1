"""Text from outside within a prompt: it is data, and cannot close its fence, end a turn or a
thought, or carry controls.
"""

#: Characters of a fenced text, and of one within a line, that are shown.
LONGEST_FENCED, LONGEST_QUOTED = 2_000, 600
FENCE = "````"
#: What ends a fence, a turn or a thought in the templates of models, and what is shown in its
#: place.
_MARKS = (
    ("```", "'''"),
    ("<|", "< |"),
    ("|>", "| >"),
    ("think>", "think >"),
    ("[INST", "[ INST"),
    ("[/INST", "[ /INST"),
)


def fenced(text: str, *, longest: int = LONGEST_FENCED) -> str:
    """Lines of text as a block of their own."""
    cut = text[:longest] + ("\n(cut)" if len(text) > longest else "")
    return f"{FENCE}\n{_harmless(cut, keep=chr(10)).strip(chr(10))}\n{FENCE}"


def quoted(text: str, *, longest: int = LONGEST_QUOTED) -> str:
    """Text as a part of one line."""
    return " ".join(_harmless(text[:longest]).split()) + ("..." if len(text) > longest else "")


def digits(value: float | None) -> str:
    """A number of a record."""
    return "no data" if value is None else f"{value:.3g}"


def _harmless(text: str, keep: str = "") -> str:
    clean = "".join(one if one.isprintable() or one in keep else " " for one in text)
    for mark, instead in _MARKS:
        clean = clean.replace(mark, instead)
    return clean
