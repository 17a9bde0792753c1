"""What diagrams are told to be, line by line as it was when the list was made: nothing about
structure changes silently.

`python tests/golden/test_golden_structure.py` writes the list anew, after a change that is meant.
"""

import hashlib
import json
from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from random_diagrams import random_legal_diagram

from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.comparison.compare import compare
from ibrid.structure.comparison.simplify import simplified
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.compiling.check import examine
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook, textbook_names
from ibrid.structure.diagrams.program import program_text
from ibrid.structure.editing.roles import roles

LIST = Path(__file__).parent / "structure.json"
DRAWN = 40


@pytest.mark.slow
def test_structures_are_told_as_before():
    known, told = json.loads(LIST.read_text()), tell()
    assert told.keys() == known.keys()
    changed = {name: (known[name], told[name]) for name in known if known[name] != told[name]}
    assert not changed


def tell() -> dict[str, object]:
    """Every line of the list."""
    rng = np.random.default_rng(26)
    diagrams = {name: textbook(name) for name in textbook_names()}
    drawn = [random_legal_diagram(rng) for _ in range(DRAWN)]
    lines = {name: _told(diagram) for name, diagram in diagrams.items()}
    lines |= {f"drawn {number}": _digest(_told(diagram)) for number, diagram in enumerate(drawn)}
    lines |= {
        f"{one} and {other}": _digest(compare(diagrams[one], diagrams[other]).to_json())
        for one, other in combinations(diagrams, 2)
    }
    for number in range(0, DRAWN, 2):
        told = compare(drawn[number], drawn[number + 1]).to_json()
        lines[f"drawn {number} and {number + 1}"] = _digest(told)
    return json.loads(json.dumps(lines))


def _told(diagram: Diagram) -> dict[str, object]:
    found = roles(diagram, VOCABULARY)
    wrong, doubtful = examine(diagram)
    half = _without_a_third_of_its_wires(diagram)
    drawing = simplified(diagram)
    blocks = {number: repr(_of_old(block)) for number, block in drawing.blocks.items()}
    links = {repr(key): weight.tolist() for key, weight in drawing.links.items()}
    return {
        "program": _digest(program_text(diagram)),
        "structure": structure_hash(diagram),
        "roles": asdict(found) if found else None,
        "simplified": _digest([blocks, links]),
        "violations": [str(one) for one in wrong],
        "doubtful": [str(one) for one in doubtful],
        "violations of half of it": [str(one) for one in examine(half)[0]],
    }


def _of_old(block) -> tuple:
    """The fields that a block had when the list was made."""
    return (
        block.kind,
        block.names,
        block.inputs,
        block.outputs,
        block.parameters,
        block.axes,
        block.siso,
        block.outer,
    )


def _without_a_third_of_its_wires(diagram: Diagram) -> Diagram:
    half = Diagram(diagram.name)
    half.extend(
        diagram.instances, [wire for number, wire in enumerate(diagram.connections) if number % 3]
    )
    return half


def _digest(told: object) -> str:
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


if __name__ == "__main__":
    LIST.write_text(json.dumps(tell(), indent=1) + "\n")
