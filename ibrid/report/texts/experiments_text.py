"""What `ibrid next` prints: sweeps and events, the most telling first, and what none of them would
tell.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.new_data.experiments import DECISIVE, SLIGHT, Experiment, hopeless, short_name
from ibrid.foreign_text import controls_shown
from ibrid.report.look.numbers import number
from ibrid.report.texts.text import table, wrapped

#: Experiments that are listed, beside the best sweep and the best place of each event; parameters
#: that are named.
LISTED, NAMED = 6, 4


@controls_shown
def format_experiments(
    experiments: Sequence[Experiment], said: Sequence[str], named: Sequence[str] = ()
) -> str:
    """The best in words, a table, and what stays open; `named` : parameters that were asked for."""
    best = experiments[0]
    do = f"record {best.event}" if best.event else "measure"
    told = ", ".join(f"{hz:g}" for hz in best.frequencies)
    parts = [
        "\n".join(wrapped(f"{do} at {best.op.name} next: it tells {_worth(best, named)}", "  "))
    ]
    parts += ["\n".join(wrapped(f"frequencies (Hz): {told}", "  "))] if told else []
    parts.append("\n".join(_table(experiments)))
    parts += ["\n".join(wrapped(sentence, "  ")) for sentence in said]
    return "\n\n".join(parts) + "\n"


def _worth(best: Experiment, named: Sequence[str]) -> str:
    """Pairs of structures in bits; without any that it tells apart, the parameters that gain
    most.
    """
    told = [pair for pair in best.separates if pair[-1] >= SLIGHT]
    pairs = [f"{short_name(a)} from {short_name(b)} by {bits:.1f} bits" for a, b, bits in told]
    return (
        f"{', '.join(pairs)} ({DECISIVE:.1f} bits are odds of 20 to 1)"
        if pairs
        else f"most of {_most(best, named)}"
    )


def _most(one: Experiment, named: Sequence[str]) -> str:
    """The named parameters, or those whose deviation falls most, with the factor."""
    names = named or sorted(one.gain, key=lambda name: one.gain[name])[:NAMED]
    return ", ".join(f"{name} (deviation x {number(one.gain[name], 2)})" for name in names)


def _table(experiments: Sequence[Experiment]) -> list[str]:
    best, blind = {one.event: one for one in reversed(experiments)}, hopeless(experiments)
    rows = [
        [
            one.op.name,
            one.event or "sweep",
            number(one.decides(blind), 3) if one.separates else "-",
            number(one.information, 3),
            number(float(np.median(list(one.gain.values()))) if one.gain else 1.0, 2),
        ]
        for place, one in enumerate(experiments)
        if place < LISTED or one is best[one.event]
    ]
    return table(
        [
            "operating point",
            "experiment",
            "structures (bits)",
            "parameters (bits)",
            "median deviation x",
        ],
        rows,
    )
