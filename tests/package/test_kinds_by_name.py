"""No kind is known by its name outside the rooms that declare kinds, write programs and hold
control practice.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from ibrid.gap.ports.port_kinds import PORT_KINDS, UNKNOWN
from ibrid.modules.vocabulary import VOCABULARY

ROOT = Path(__file__).parents[2]
ROOMS = ("ibrid", "search/ibrid_search", "search/policy/ibrid_policy")
#: Declarations, programs (the textbook, the true ones, those drawn for training) and control
#: practice.
NAMED_HERE = (
    "ibrid/modules/",
    "ibrid/gap/ports/port_kinds.py",
    "ibrid/structure/programs/",
    "ibrid/structure/published/",
    "ibrid/parts/",
    "ibrid/plants/true_program.py",
    "search/policy/ibrid_policy/experience/",
)
#: "LCL" and "L" are the two filters of the reference inverters' own parameters, whatever diagrams
#: call them.
FILTER_WORDS = "ibrid/plants/"
#: UNKNOWN's is an element of FMI's model description as well.
NAMES = {kind.name for kind in (*VOCABULARY, *PORT_KINDS) if kind is not UNKNOWN}
#: Names that are no English words: no sentence holds them either.
WORDS = re.compile(
    r"\b("
    + "|".join(sorted(NAMES - {"Gain", "Delay", "Share", "Notch", "PI", "LCL"}, key=len))
    + r")\b"
)


@pytest.mark.slow
def test_no_kind_is_known_by_its_name():
    known = [line for file in _files() for line in _literals(file)]
    assert not known, "\n".join(known)


def _files() -> Iterator[Path]:
    for room in ROOMS:
        for file in sorted((ROOT / room).rglob("*.py")):
            if not file.relative_to(ROOT).as_posix().startswith(NAMED_HERE):
                yield file


def _literals(file: Path) -> Iterator[str]:
    """Strings that are a kind's name, or say one in a sentence; parts of f-strings, keys and
    docstrings' neighbours alike.
    """
    tree = ast.parse(file.read_text(encoding="utf-8"))
    place = file.relative_to(ROOT).as_posix()
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if (
            not isinstance(node, ast.Constant)
            or not isinstance(node.value, str)
            or id(node) in docstrings
        ):
            continue
        if node.value == "LCL" and place.startswith(FILTER_WORDS):
            continue
        if node.value in NAMES or WORDS.search(node.value):
            yield f"{place}:{node.lineno}: {node.value!r}"
