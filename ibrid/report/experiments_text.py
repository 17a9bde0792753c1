"""What `ibrid next` prints: sweeps, the most telling first, and what no sweep would tell."""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.experiments import DECISIVE, Experiment
from ibrid.report.numbers import number
from ibrid.report.text import table, wrapped

#: Sweeps and parameters that are listed.
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
    told = ", ".join(f"{hz:g}" for hz in best.frequencies)
    parts = [
        "\n".join(wrapped(f"measure at {best.op.name} next: {worth}", "  ")),
        "\n".join(wrapped(f"frequencies (Hz): {told}", "  ")),
        "\n".join(_table(found)),
    ]
    parts += ["\n".join(wrapped(sentence, "  ")) for sentence in said]
    return "\n\n".join(parts) + "\n"


def _most(one: Experiment) -> str:
    """The parameters whose deviation falls most, with the factor."""
    names = sorted(one.gain, key=lambda name: one.gain[name])[:NAMED]
    return ", ".join(f"{name} (deviation x {number(one.gain[name], 2)})" for name in names)


def _table(found: Sequence[Experiment]) -> list[str]:
    rows = [
        [
            one.op.name,
            number(one.decides, 3) if one.separates else "-",
            number(one.information, 3),
            number(float(np.median(list(one.gain.values()))) if one.gain else 1.0, 2),
        ]
        for one in found[:LISTED]
    ]
    return table(["operating point", "structures (bits)", "parameters (bits)", "median deviation x"], rows)
