"""Where answers go: JSON to a file or, for "-", to the terminal; sentences about a wrong input to the error stream."""

import json
import sys
from argparse import ArgumentParser
from collections.abc import Iterable
from typing import Any

from ibrid.writing import require_place, write_whole

TERMINAL = "-"


def add_json_option(parser: ArgumentParser) -> None:
    """`--json [OUT]`."""
    parser.add_argument(
        "--json", nargs="?", const=TERMINAL, metavar="OUT", help="write JSON to OUT; alone or with -, print it instead"
    )


def require_json_place(where: str | None) -> None:
    """Raise IbridError before any work when `--json OUT` cannot be written."""
    if where is not None and where != TERMINAL:
        require_place(where)


def give_json(content: Any, where: str | None) -> bool:
    """Write or print JSON as asked; True when it was printed, so that the table is left out."""
    if where is None:
        return False
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    if where == TERMINAL:
        sys.stdout.write(text)
        return True
    write_whole(where, text)
    return False


def complain(sentence: str) -> None:
    """One line on the error stream."""
    print(f"ibrid: {' '.join(sentence.split())}", file=sys.stderr)


def table(rows: Iterable[Iterable[str]], indent: str = "") -> str:
    """Left-aligned columns, two spaces apart; the last column may be of any width."""
    cells = [list(row) for row in rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    return "\n".join(
        (indent + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))).rstrip()
        for row in cells
    )
