"""How set points are followed, measured and modelled, row by row, for a page and for a terminal."""

from collections.abc import Mapping
from typing import Any

from ibrid.report.look.numbers import number

#: What is timed, and the head of the columns.
TIMES = ("reaction_s", "rise_s", "settling_s")
STEP_HEAD = ["record", "step", "reaction (ms)", "rise (ms)", "settling (ms)", "overshoot (%)"]


def step_rows(steps: Mapping[str, Any]) -> list[list[str]]:
    """The cells of what `ibrid.playback.step_figures` finds, two rows a record."""
    return [
        [
            record,
            f"{figures['set_point']} at {figures['at_s']:.4g} s, {side}",
            *(
                number(None if (one := figures[side][key]) is None else 1e3 * one, 3)
                for key in TIMES
            ),
            number(100.0 * figures[side]["overshoot"], 2),
        ]
        for record, figures in steps.items()
        for side in ("measured", "model")
    ]
