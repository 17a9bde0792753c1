"""`python -m ibrid_bench.events`: how often `ibrid gap` names the limit or block that a device with
records of events hides.

Devices are simulated apart from the package (`device`), models are theirs without what is hidden,
their nominal values 15 % off; half of the cases have a sweep beside the records. Recorders, edges
and noises are those of `conditions`. The last record is held out and predicted. What is hidden
changes what is recorded by 5 % at least; of a limit that is not reached nothing may be said.
"""

import argparse
import time
from pathlib import Path
from statistics import median
from typing import Any

from ibrid_bench.events.cases import HIDDEN, EventCase, draw
from ibrid_bench.events.conditions import LEVELS, Conditions, conditions
from ibrid_bench.events.families import BLOCKS, draw_family
from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.markdown import markdown_table, write_between

from ibrid.errors import IbridError
from ibrid.gap.workflow import find_gap

BEGIN, END = "<!-- made by ibrid_bench.events -->", "<!-- end of events -->"
#: What the catalogue calls a hidden block.
EFFECTS = {
    "pll_filter": "pll_prefilter",
    "delay": "control_delay",
    "damping": "active_damping",
    "feedforward_filter": "voltage_feedforward_filter",
}
KINDS = (*HIDDEN, *BLOCKS)
#: Where nothing is to be named.
NOTHING = ("nothing", "unreached", "family_nothing")
SILENT = ("no-gap", "parameters-only")
#: Stated floors up to which a held-out record counts as predicted.
PREDICTED = 1.5


def main() -> int:
    """Measure what is missing in --out, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=12, help="devices of each kind (12)")
    parser.add_argument("--seed", type=int, default=0, help="of the first (0)")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        choices=KINDS,
        help="what is hidden, repeatable (all)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-events"), help="folder of the results"
    )
    parser.add_argument("--page", type=Path, help="write the table between its marks in this page")
    options = parser.parse_args()
    return resumable("bench-events", options.out, lambda: _measure(options))


def _measure(options: argparse.Namespace) -> int:
    ledger = Ledger(options.out)
    for seed in range(options.seed, options.seed + options.cases):
        for hidden in options.only or KINDS:
            key = f"{hidden}/{seed}"
            if key not in ledger.rows:
                ledger.add({"key": key, **_row(hidden, seed)})
                print(
                    key,
                    {name: value for name, value in ledger.rows[key].items() if name != "key"},
                    flush=True,
                )
    table = table_of(ledger)
    print(table)
    if options.page:
        write_between(options.page, BEGIN, END, table)
    return 0


def table_of(ledger: Ledger) -> str:
    """How often each was named, by what was hidden and by the noise."""
    rows = []
    for hidden in KINDS:
        own = [row for row in ledger.rows.values() if row["hidden"] == hidden]
        if own:
            right = "silent" if hidden in NOTHING else "first"
            by_noise = ([row[right] for row in own if row["noise_db"] == level] for level in LEVELS)
            counts = [
                f"{sum(bool(one) for one in each)} of {len(each)}" if each else ""
                for each in by_noise
            ]
            predicted = f"{sum(bool(row['predicted']) for row in own)} of {len(own)}"
            rows.append(
                [hidden, *counts, predicted, f"{median(row['seconds'] for row in own):.0f}"]
            )
    names = ["clean" if level is None else f"{level:g} dB" for level in LEVELS]
    return markdown_table(("hidden", *names, "predicted", "seconds, median"), rows)


def case_of(hidden: str, seed: int) -> tuple[EventCase, Conditions]:
    """A drawn device that hides this, and how it was recorded."""
    under = conditions(KINDS.index(hidden), seed)
    drawn = draw_family if hidden in BLOCKS else draw
    return drawn(
        hidden, seed, under.noise_db, swept=under.swept, recorder=under.recorder, rise=under.rise
    ), under


def _row(hidden: str, seed: int) -> dict[str, Any]:
    case, under = case_of(hidden, seed)
    told = {
        "hidden": hidden,
        "swept": under.swept,
        "rise": under.rise,
        **vars(under.recorder),
        "limits": dict(case.limits),
    }
    began = time.process_time()
    try:
        gap = find_gap(
            case.diagram,
            case.sweep,
            case.values,
            events=case.events,
            holdout_op=(case.held,),
            progress="silent",
        )
    except IbridError as error:
        nothing = dict.fromkeys(("first", "alike", "silent", "predicted"), False)
        return {
            **told,
            **nothing,
            "verdict": f"error: {error}",
            "named": [],
            "seconds": time.process_time() - began,
        }
    named, effect = [one.id for one in gap.effects], EFFECTS.get(hidden, hidden)
    alike = named and effect in (named[0], *gap.effects[0].indistinguishable_from)
    floor = gap.events.floors[case.held] if gap.events else None
    return {
        **told,
        "verdict": gap.verdict,
        "named": named,
        "first": named[:1] == [effect],
        "alike": bool(alike),
        "silent": gap.verdict in SILENT,
        "predicted": _predicted(gap.after["holdout"], floor),
        "errors": [
            gap.before["refit"],
            gap.after["refit"],
            gap.after["holdout"],
            gap.noise_floor,
            floor,
        ],
        "seconds": time.process_time() - began,
    }


def _predicted(error: float | None, floor: float | None) -> bool:
    """Whether the record that was held out is predicted within some of the floors that are said of
    it.
    """
    return error is not None and floor is not None and error < PREDICTED * floor


if __name__ == "__main__":
    raise SystemExit(main())
