"""The page docs/learning_results.md, made from the rows of the ledger."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ibrid_bench.learning.arms import (
    ALL_ARMS,
    ARMS,
    HELD_OUT,
    INVERTERS,
    KNOWN,
    PROFILE,
    SEEDS,
    Case,
    arm_of,
)
from ibrid_bench.learning.comparison import (
    Row,
    Rows,
    budgets,
    current,
    longest_of_chance,
    newest_weights,
)
from ibrid_bench.learning.tables import (
    answers_table,
    arms_table,
    inverters_table,
    pairs_table,
    sentences,
    updates_table,
)
from ibrid_policy.learning.settings import PROFILES
from jinja2 import StrictUndefined, Template

#: Arms that are no part of the comparison, told of where they are measured.
CONTROLS = ("untrained", "blind", "diagnosis", "informed")


def page(rows: Iterable[Row]) -> str:
    """Markdown, by page.md: a section for each budget; what is missing says so."""
    kept = current(rows)
    chance = longest_of_chance(kept)
    words = (Path(__file__).parent / "page.md").read_text(encoding="utf-8")
    text = Template(words, trim_blocks=True, undefined=StrictUndefined).render(
        arms=[(name, ALL_ARMS[name].words) for name in ARMS],
        controls=[name for name in CONTROLS if any(arm_of(row["arm"]) == name for row in kept)],
        known=_names(KNOWN),
        held_out=_names(HELD_OUT),
        weights=newest_weights(kept),
        parts=[
            _section([row for row in kept if row["budget"] == one], one, chance)
            for one in budgets(kept)
        ],
        nothing=measured_of([]),
        profile=PROFILE,
    )
    return text.rstrip() + "\n"


def measured_of(rows: Rows) -> str:
    """How much of the comparison with one budget is there, in a sentence."""
    whole = len(INVERTERS) * len(ARMS) * SEEDS
    compared = _compared(ARMS)
    asked = {
        (row["inverter"], row["arm"], row["seed"])
        for row in rows
        if row["arm"] in compared and row["inverter"] in INVERTERS and row["seed"] < SEEDS
    }
    runs = f"of the {whole} runs ({len(INVERTERS)} inverters, {len(ARMS)} arms, {SEEDS} seeds)"
    return f"{len(asked)} {runs} are measured." if asked else f"None {runs} is measured yet."


def _compared(arms: Iterable[str]) -> set[str]:
    """What the rows of these arms are called, those of learning with the profile that is
    compared.
    """
    return {Case("", arm, 0, 1, PROFILES[PROFILE], "").label for arm in arms}


def _section(rows: Rows, budget: int, chance: Rows) -> dict[str, Any]:
    known = _compared(ALL_ARMS)
    compared = [row for row in rows if row["arm"] in known]
    return {
        "budget": budget,
        "measured": measured_of(rows),
        "sentences": sentences(compared, chance),
        "all": arms_table(compared),
        "pairs": pairs_table(compared),
        "answers": answers_table(compared),
        "inverters": inverters_table(compared),
        "updates": updates_table(compared),
        "tried": _tried(rows),
    }


def _tried(rows: Rows) -> dict[str, str]:
    """Other ways of learning beside the arms that they are compared with."""
    known = _compared(ALL_ARMS)
    tried = [row for row in rows if row["arm"] not in known]
    if not tried:
        return {}
    return {
        "arms": arms_table(tried),
        "updates": updates_table(tried),
    }


def _names(names: Iterable[str]) -> str:
    *first, last = (f"`{name}`" for name in names)
    return f"{', '.join(first)} and {last}"
