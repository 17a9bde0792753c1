"""The page about the diagrams that ship: what each is, and its picture."""

import ast
from collections.abc import Iterator, Sequence

from ibrid.structure.diagrams.library import (
    published_names,
    textbook,
    textbook_names,
    textbook_text,
)

_TOP = """\
# Built-in diagrams

Made from the programs in `ibrid/structure` by `python docs/making/write_pages.py`; a test compares
the two. A name can be used wherever a command takes a PROGRAM, as in
`ibrid evaluate gfl sweep.csv`; to start a program of your own, print one with
`print(ibrid.program_text(ibrid.textbook("gfl")))`. Searches begin with those that a screening of
the data ranks best.

The site, built by `make docs`, draws them with the blocks of [Module kinds](modules.md), coloured
by family. Thick lines carry a dq pair, thin ones a scalar; circles add and subtract; dashed frames
are loops.
"""


def diagrams_page() -> str:
    """Markdown: a table of all, then each with its picture."""
    groups = {"Textbook diagrams": textbook_names(), "Published controls": published_names()}
    tables = "\n".join(_table(title, names) for title, names in groups.items())
    return "\n".join(
        [
            _TOP,
            tables,
            *(part for names in groups.values() for name in names for part in _section(name)),
        ]
    )


def _table(title: str, names: Sequence[str]) -> str:
    rows = "".join(
        f"| [`{name}`](#{name}) | {_words(name)} | {len(textbook(name).instances)} |\n"
        for name in names
    )
    return f"**{title}**\n\n| name | what | blocks |\n| --- | --- | --- |\n{rows}"


def _section(name: str) -> Iterator[str]:
    yield f"## {name}\n"
    yield f"<!-- diagram {name} -->\n"


def _words(name: str) -> str:
    (function,) = ast.parse(textbook_text(name)).body
    words = " ".join((ast.get_docstring(function) or "").split())
    for mark in ("_", "*", "|"):
        words = words.replace(mark, f"\\{mark}")
    return words
