"""The comparison as tables in Markdown, aligned so that a terminal shows them too."""

from collections.abc import Callable, Collection, Mapping, Sequence
from math import isfinite
from statistics import fmean
from typing import Any

from ibrid_bench.learning.arms import ALL_ARMS, DRAWN, HELD_OUT, INVERTERS, KNOWN, arm_of
from ibrid_bench.learning.comparison import (
    AREA,
    MEASURES,
    TO_PAPER_ERROR,
    Measure,
    Row,
    Rows,
    labels,
    of_arm,
    of_pair,
    pairs,
    part,
    share,
    typical_error,
    verdict,
)
from ibrid_bench.learning.course import final_error
from ibrid_bench.learning.statistics import Estimate
from ibrid_bench.learning.updates import TOLD
from ibrid_bench.search.scoring import PAPER_ERROR
from ibrid_policy.learning.updates import mean_of_known

#: Where the inverters come from, as the tables call them.
PLACES: Mapping[str, tuple[str, Collection[str]]] = {
    "all": ("all inverters", INVERTERS),
    "trained on": ("families it was trained on", KNOWN),
    "held out": ("held-out families", HELD_OUT),
    "drawn": ("drawn inverters of held-out families", DRAWN),
}
_WIDTHS = (20, 15, 4, 4)


def heading() -> str:
    """Names of the columns of `line`."""
    return _fixed(
        (
            "inverter",
            "arm",
            "seed",
            "evaluations",
            "NRMSE",
            "to 0.0435",
            "to 1e-3",
            "area",
            "F1 mod/con",
            "s",
        )
    )


def line(row: Row) -> str:
    """A search, for the terminal."""
    reached = (_evaluations(measure.of(row), row["budget"]) for measure in MEASURES[:2])
    return _fixed(
        (
            row["inverter"],
            row["arm"],
            str(row["seed"]),
            str(row["evaluations"]),
            f"{10 ** final_error(row):.2g}",
            *reached,
            f"{AREA.of(row):.2f}",
            f"{row['modules_f1']:.2f}/{row['connections_f1']:.2f}",
            f"{row['seconds']:.0f}",
        )
    )


def arms_table(rows: Rows, inverters: Collection[str] = INVERTERS) -> str:
    """Every arm that was run on these inverters, with one budget: medians with 95 % intervals."""
    lines = []
    for label in labels(rows):
        own = part(rows, label, inverters)
        if own:
            numbers = (_estimate(of_arm(own, one), one, own[0]["budget"]) for one in MEASURES)
            lines.append([label, str(len(own)), *numbers])
    return table(["arm", "runs", *(one.title for one in MEASURES)], lines)


def answers_table(rows: Rows) -> str:
    """What became of the answers of every arm's proposers, drawn inverters included, and how long a
    run took.
    """
    names = ("valid", "known", "refused", "failed")
    lines = []
    for label in labels(rows):
        own = part(rows, label, (*INVERTERS, *DRAWN))
        shares = (_percent(share(own, name)) for name in names)
        lines.append([label, str(len(own)), *shares, f"{fmean(row['seconds'] for row in own):.0f}"])
    return table(["arm", "runs", *names, "seconds"], lines)


def pairs_table(rows: Rows, wanted: Sequence[tuple[str, str]] | None = None) -> str:
    """Mean differences of two arms over pairs of the same inverter and seed, with 95 % intervals;
    "*" where zero lies outside.

    wanted : the arms; None: all whose difference says something.
    """
    lines = []
    for first, second in pairs(labels(rows)) if wanted is None else wanted:
        for place, (_, inverters) in PLACES.items():
            own = [row for row in rows if row["inverter"] in inverters]
            found = [of_pair(own, first, second, one) for one in MEASURES]
            if found[0] is not None:
                cells = (
                    _difference(estimate, one)
                    for estimate, one in zip(found, MEASURES, strict=True)
                )
                lines.append([f"{first} - {second}", place, str(found[0].number), *cells])
    return table(["difference", "inverters", "pairs", *(one.title for one in MEASURES)], lines)


def inverters_table(rows: Rows) -> str:
    """For each inverter and arm the median of the best error at the end, and how many runs came to
    the paper's error.
    """
    found = labels(rows)
    lines = []
    for name in (*INVERTERS, *sorted({row["inverter"] for row in rows} & set(DRAWN))):
        cells = []
        for label in found:
            own = part(rows, label, (name,))
            error, reached = (
                typical_error(own),
                sum(isfinite(TO_PAPER_ERROR.of(row)) for row in own),
            )
            cells.append("-" if error is None else f"{error:.2g}, {reached} of {len(own)}")
        lines.append(
            [f"`{name}`", "held out" * (name in HELD_OUT) or "drawn" * (name in DRAWN), *cells]
        )
    return table(["inverter", "", *found], lines)


def updates_table(rows: Rows) -> str:
    """What learning tells of itself in each part of a run (`ibrid_bench.learning.updates.told`):
    means over the runs of an arm, drawn inverters included.
    """
    lines = []
    for label in (one for one in labels(rows) if ALL_ARMS[arm_of(one)].learns):
        own = [row["updates"] for row in part(rows, label, (*INVERTERS, *DRAWN))]
        for number in range(max(map(len, own), default=0)):
            there = [updates[number] for updates in own if len(updates) > number]
            lines.append(
                [label, str(number + 1), str(len(there)), *(_mean(there, name) for name in TOLD)]
            )
    return table(["arm", "part", "runs", *TOLD], lines)


def sentences(rows: Rows, chance: Rows = ()) -> list[str]:
    """What was asked of the policy and of learning, beside what was found; nothing of what is not
    measured.

    chance : random edits with a larger budget, where such were searched; see `longest_of_chance`.
    """
    told = []
    frozen, chance = part(rows, "frozen", INVERTERS), chance or part(rows, "random", INVERTERS)
    valid, known = (share(frozen, name) for name in ("valid", "known"))
    if valid is not None and known is not None:
        told.append(
            f"Of the answers of the frozen policy {_percent(valid + known)} were legal edits, "
            f"{_percent(valid)} to something new "
            f"and {_percent(known)} to a structure met before or to the parent's; asked: 80 % "
            "valid."
        )
    if frozen and chance:
        found = [(of_arm(own, TO_PAPER_ERROR), own[0]["budget"]) for own in (frozen, chance)]
        needed = [_estimate(one, TO_PAPER_ERROR, budget) for one, budget in found]
        told.append(
            f"To {PAPER_ERROR:g} the frozen policy needs {needed[0]} evaluations in the median, "
            f"random edits {needed[1]}; asked: "
            "a third of theirs."
        )
    for first, second in pairs(labels(rows)):
        if second == "random":  # told above
            continue
        for place, inverters in PLACES.values():
            found = of_pair(
                [row for row in rows if row["inverter"] in inverters], first, second, AREA
            )
            if found is not None:
                told.append(
                    f"`{first}` against `{second}`, {place} (pairs: {found.number}): mean "
                    "difference of the area "
                    f"{_difference(found, AREA).removesuffix(' *')}, {verdict(AREA, found)}."
                )
    return told


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown with columns of even width; a sentence where there are no rows."""
    if not rows:
        return "Nothing of it is measured yet.\n"
    widths = [
        max(3, *(len(cells[column]) for cells in (header, *rows))) for column in range(len(header))
    ]
    lines = [header, ["-" * width for width in widths], *rows]
    padded = (
        " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        for cells in lines
    )
    return "".join(f"| {one} |\n" for one in padded)


def _estimate(found: Estimate | None, measure: Measure, budget: int) -> str:
    if found is None:
        return "-"
    words: Callable[[float], str] = lambda value: _number(value, measure, budget)  # noqa: E731
    if found.low is None or found.high is None or words(found.low) == words(found.high):
        return words(found.value)
    return f"{words(found.value)} [{words(found.low)}, {words(found.high)}]"


def _difference(found: Estimate | None, measure: Measure) -> str:
    if found is None:
        return "-"
    digits = "+.1f" if measure.unit == "evaluations" else "+.2f"
    if found.low is None or found.high is None:
        return f"{found.value:{digits}}"
    return (
        f"{found.value:{digits}} [{found.low:{digits}}, {found.high:{digits}}]"
        + " *" * found.excludes_zero
    )


def _number(value: float, measure: Measure, budget: int) -> str:
    return _evaluations(value, budget) if measure.unit == "evaluations" else f"{value:.2f}"


def _evaluations(value: float, budget: int) -> str:
    return f"{value:.0f}" if isfinite(value) else f"> {budget}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def _mean(updates: Sequence[dict[str, Any]], name: str) -> str:
    found = mean_of_known(one[name] for one in updates)
    return "-" if found is None else f"{found:.3g}"


def _fixed(cells: Sequence[str]) -> str:
    first = [f"{cell:{width}}" for cell, width in zip(cells[:3], _WIDTHS, strict=False)]
    return " ".join([*first, *(f"{cell:>11}" for cell in cells[3:])])
