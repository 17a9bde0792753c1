"""Control practice as it stands: every edit of the catalogue and every move of the rules, on
diagrams of many kinds.

A file for each diagram in practice/, a line an edit, and families.txt. After a change that is
meant: `python tests/golden/test_golden_practice.py`, and say in the commit which lines changed and
why.
"""

import re
from difflib import unified_diff
from pathlib import Path

import pytest

from ibrid.modules import PAPER_VOCABULARY, VOCABULARY
from ibrid.parts.anywhere.blocks import twin_removals
from ibrid.parts.catalogue import FAMILIES, insertions
from ibrid.parts.editing.view import view_of, views_of
from ibrid.structure import Diagram, parse_program, structure_hash, textbook, textbook_names

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests" / "golden"
PROGRAMS = ROOT / "search" / "ibrid_bench" / "search" / "programs"
#: Effects that are put into a textbook diagram one by one; the diagrams that come out are edited as
#: well.
PUT_IN = {
    "gfl_exact": (
        "command_filter",
        "active_damping",
        "virtual_impedance",
        "frequency_droop",
        "voltage_sensor",
    ),
    "gfl_dc_link": ("command_filter",),
    "gfm_vsm": ("control_delay",),
}


def diagrams() -> dict[str, tuple[Diagram, tuple]]:
    """Name -> diagram and vocabulary."""
    found = {name: (textbook(name), VOCABULARY) for name in textbook_names()}
    found |= {f"{name}, paper": (textbook(name), PAPER_VOCABULARY) for name in ("naive", "gfl")}
    found |= {
        one.stem: (parse_program(one.read_text("utf-8")), VOCABULARY)
        for one in sorted(PROGRAMS.glob("*.py"))
    }
    for name, effects in PUT_IN.items():
        edits = insertions(textbook(name), VOCABULARY)
        for effect in effects:
            first = next(one for one in edits if one.effect == effect)
            found[f"{name}, {first.change} {effect}"] = (first.diagram, VOCABULARY)
    return found


def _hash(diagram: Diagram, kinds: tuple) -> str:
    return structure_hash(diagram, kinds)[:8]


def edits_of(diagram: Diagram, kinds: tuple) -> list[str]:
    """A line for each edit of the catalogue: effect, change, place, hash, new parameters with what
    does nothing.
    """
    return [
        f"{one.effect} | {one.change} | {one.where} | {_hash(one.diagram, kinds)} | "
        + ", ".join(
            f"{name}: {' '.join(f'{value:.6g}' for value in bank)}"
            + (f" ({one.nothing[name]:g})" if name in one.nothing else "")
            for name, bank in one.parameters.items()
        )
        for one in insertions(diagram, kinds)
    ]


def moves_of(diagram: Diagram, kinds: tuple) -> list[str]:
    """A line for each move of the rules, and of the pruning alone, in order: family, note, weight
    if not 1, hash.
    """
    views = views_of(diagram, kinds)
    families = [(one.name, one.moves) for one in FAMILIES] + [("twins", twin_removals)]
    return [
        f"{name} | {view.words(move)} | "
        f"{'' if move.weight == 1 else f'{move.weight:g} | '}{_hash(view.after(move), kinds)}"
        for name, moves in families
        for view in views
        for move in moves(view)
    ]


def practice() -> dict[str, str]:
    """Name of a file -> what it says of one diagram."""
    return {
        re.sub(r"[^a-z0-9_]+", "_", name) + ".txt": "\n".join(
            [
                f"# {name}",
                "",
                "## effects",
                *edits_of(*drawn),
                "",
                "## moves",
                *moves_of(*drawn),
                "",
            ]
        )
        for name, drawn in diagrams().items()
    }


@pytest.mark.nightly
def test_every_effect_and_every_move_edits_every_diagram_as_it_did():
    golden = {path.name: path.read_text("utf-8") for path in (GOLDEN / "practice").glob("*.txt")}
    now = practice()
    assert set(now) == set(golden)
    changed = [
        f"{name}: {line}"
        for name in now
        for line in unified_diff(
            golden[name].splitlines(), now[name].splitlines(), n=0, lineterm=""
        )
    ]
    assert not changed, "\n".join(
        ["control practice changed (the docstring says what to do):", *changed[:60]]
    )


def test_the_families_of_moves_keep_their_order_weights_and_bands():
    assert families() == (GOLDEN / "families.txt").read_text("utf-8").splitlines()


def families() -> list[str]:
    return [
        f"{one.name} | {one.scale} | {' '.join(map(str, one.bands))} | {one.weight:g} | first "
        f"{one.first} | "
        f"any time {one.any_time} | if gross {one.if_gross}"
        for one in FAMILIES
    ]


def test_a_diagram_without_a_command_has_no_moves():
    assert view_of(Diagram("empty"), VOCABULARY) is None


if __name__ == "__main__":
    for name, text in practice().items():
        (GOLDEN / "practice" / name).write_text(text, "utf-8")
    (GOLDEN / "families.txt").write_text("\n".join([*families(), ""]), "utf-8")
