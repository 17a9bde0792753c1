"""What `ibrid next` prints: sweeps and events, the most telling first, and what none of them would tell."""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.experiments import DECISIVE, Experiment
from ibrid.report.numbers import number
from ibrid.report.text import table, wrapped

#: Experiments that are listed, beside the best sweep and the best place of each event; parameters that are named.
LISTED, NAMED = 6, 4


def format_experiments(found: Sequence[Experiment], said: Sequence[str]) -> str:
    """The best in words, a table, and what stays open."""
    best = found[0]
    pairs = [f"{one[:8]} from {other[:8]} by {bits:.1f} bits" for one, other, bits in best.separates]
    worth = (
        f"it tells {', '.join(pairs)} ({DECISIVE:.1f} bits are odds of 20 to 1)"
        if pairs
        else f"it tells most of {_most(best)}"
    )
    do = f"record {best.event}" if best.event else "measure"
    told = ", ".join(f"{hz:g}" for hz in best.frequencies)
    parts = ["\n".join(wrapped(f"{do} at {best.op.name} next: {worth}", "  "))]
    parts += ["\n".join(wrapped(f"frequencies (Hz): {told}", "  "))] if told else []
    parts.append("\n".join(_table(found)))
    parts += ["\n".join(wrapped(sentence, "  ")) for sentence in said]
    return "\n\n".join(parts) + "\n"


def _most(one: Experiment) -> str:
    """The parameters whose deviation falls most, with the factor."""
    names = sorted(one.gain, key=lambda name: one.gain[name])[:NAMED]
    return ", ".join(f"{name} (deviation x {number(one.gain[name], 2)})" for name in names)


def _table(found: Sequence[Experiment]) -> list[str]:
    best = {one.event: one for one in reversed(found)}
    rows = [
        [
            one.op.name,
            one.event or "sweep",
            number(one.decides, 3) if one.separates else "-",
            number(one.information, 3),
            number(float(np.median(list(one.gain.values()))) if one.gain else 1.0, 2),
        ]
        for place, one in enumerate(found)
        if place < LISTED or one is best[one.event]
    ]
    return table(
        ["operating point", "experiment", "structures (bits)", "parameters (bits)", "median deviation x"], rows
    )
