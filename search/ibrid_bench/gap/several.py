"""Trials beside the table: three effects at once, and models with a block that the device lacks
beside what they miss.
"""

from collections.abc import Sequence

import numpy as np
from ibrid_bench.gap.trials import MAIN, Trial
from ibrid_bench.hidden.bases import BASES, draw_base
from ibrid_bench.hidden.declaration import SEVERITIES, HiddenEffect
from ibrid_bench.hidden.effects import HIDDEN

#: How many effects are hidden, and how many of them are blocks of the model that must go.
GROUPS = {"three": (3, 0), "missing and wrong": (2, 1), "two missing and wrong": (3, 1)}
#: So many trials of each group for a table of 200; their seeds begin beyond those of the table.
NUMBER, FIRST = 30, 1000


def several(cases: int, seed: int) -> tuple[Trial, ...]:
    """Trials of every group in the main settings, the same for the same seed."""
    rng = np.random.default_rng([seed, 2])
    found: list[Trial] = []
    for count, wrong in GROUPS.values():
        for place in range(NUMBER * cases // 200):
            noise, frequencies, points = MAIN[place % len(MAIN)]
            effects = tuple(one.key for one in _drawn(count, wrong, rng))
            kind, severity = "pair" if count == 2 else "triple", SEVERITIES[place % len(SEVERITIES)]
            found.append(
                Trial(
                    kind,
                    effects,
                    severity,
                    noise,
                    frequencies,
                    points,
                    10_000 * seed + FIRST + len(found),
                )
            )
    return tuple(found)


def group_of(effects: Sequence[str]) -> str:
    """The group of a trial's effects; "" where it has none of these."""
    sizes = len(effects), sum(":remove:" in one for one in effects)
    return next((name for name, size in GROUPS.items() if size == sizes), "")


def _drawn(count: int, wrong: int, rng: np.random.Generator) -> tuple[HiddenEffect, ...]:
    """Effects with a name that one structure can hide together, so many of them to be removed."""
    named = [one for one in HIDDEN if one.verdicts[0] == "named"]
    gone, missing = (
        [one for one in named if (one.change == "remove") is remove] for remove in (True, False)
    )
    while True:
        pools = [gone] * wrong + [missing] * (count - wrong)
        chosen = tuple(pool[int(rng.integers(len(pool)))] for pool in pools)
        if _fit(chosen) and any(
            all(one.fits(draw_base(name, rng)) for one in chosen) for name in BASES
        ):
            return chosen


def _fit(effects: Sequence[HiddenEffect]) -> bool:
    pairs = [(one, other) for place, one in enumerate(effects) for other in effects[:place]]
    return all(one.id != other.id and one.together_with(other) for one, other in pairs)
