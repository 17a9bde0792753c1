"""An output of a notebook: one element with a style of its own, and names that outputs on one page do not share."""

from collections.abc import Iterable
from hashlib import sha256

from ibrid.report.style import notebook_style_sheet


def output(parts: Iterable[str]) -> str:
    """The parts in one element; its style reaches nothing else."""
    return f'<div class="ibrid"><style>{notebook_style_sheet()}</style>{"".join(parts)}</div>'


def tag(text: str) -> str:
    """A name for the figures of an output, from what the output is about."""
    return f"n{sha256(text.encode()).hexdigest()[:10]}"
