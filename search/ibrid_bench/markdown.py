"""Tables in Markdown, for the pages that benchmarks and docs are made of."""

import re
from collections.abc import Sequence
from pathlib import Path


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with these columns; a `|` within a cell is written so that it stays there."""
    lines = [
        header,
        ("---",) * len(header),
        *(tuple(cell.replace("|", r"\|") for cell in row) for row in rows),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def write_between(page: Path, begin: str, end: str, table: str) -> None:
    """A table between its marks in a page, in place of what was there."""
    marked = re.compile(f"{re.escape(begin)}.*{re.escape(end)}", re.DOTALL)
    text = page.read_text(encoding="utf-8")
    page.write_text(marked.sub(lambda _: f"{begin}\n{table}\n{end}", text), encoding="utf-8")
