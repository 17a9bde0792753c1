"""`python -m ibrid_bench.gap.labels`: how often a wrong label is found, and how often right ones
are called wrong.

Each device of the independent generator is its model, 15 % off in its nominal values, measured with
noise; one label at a time is written wrongly. p and q, v and the base can stand for each other: a
label counts as found where it is named or told as one that these data cannot tell from the named
one.
"""

import argparse
import time
from collections.abc import Mapping
from pathlib import Path

from ibrid_bench.hidden.case import Case, draw_case
from ibrid_bench.ledger import Ledger, resumable

from ibrid.gap.workflow import find_gap
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.program import parse_program

ROOT_2, ROOT_3 = 2**0.5, 3**0.5
#: What the file says, over the truth.
WRONG: Mapping[str, tuple[str, Convention]] = {
    "none": ("", Convention()),
    "power, peak as rms": ("power_scale", Convention(power=ROOT_2)),
    "power, line as phase": ("power_scale", Convention(power=1 / ROOT_3)),
    "voltage, peak as rms": ("voltage_scale", Convention(voltage=ROOT_2)),
    "base, Park": ("base_impedance", Convention(factor=1.5)),
    "current": ("current_sign", Convention(sign=-1)),
    "q axis": ("q_axis", Convention(q=-1)),
    "node": ("power_node", Convention(node="pcc")),
    "frame, 7 degrees": ("frame_misalignment", Convention(angle=0.12)),
    "voltage on q": ("axes_exchanged", Convention(axes=-1)),
    "d and q exchanged": ("axes_exchanged", Convention(axes=-1, q=-1)),
}
LEVELS = (40.0, 60.0)


def written_wrongly(sweep: Sweep, wrong: Convention) -> Sweep:
    """The sweep as a file with that label has it."""
    node = (
        None if wrong.node is None else ("pcc" if sweep.power_node == "capacitor" else "capacitor")
    )
    inverse = Convention(
        wrong.sign,
        wrong.q,
        1 / wrong.factor,
        (),
        -wrong.angle,
        1 / wrong.power,
        1 / wrong.voltage,
        node,
        wrong.axes,
    )
    return inverse.undone(sweep)


def main() -> int:
    """Measure what is missing in --out, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20, help="devices (20)")
    parser.add_argument("--seed", type=int, default=0, help="of the first device (0)")
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-labels"), help="folder of the results"
    )
    options = parser.parse_args()
    return resumable("bench-labels", options.out, lambda: _table(options))


def _table(options: argparse.Namespace) -> int:
    ledger = Ledger(options.out)
    for seed in range(options.seed, options.seed + options.cases):
        case = draw_case("nothing", seed, noise_db=LEVELS[seed % len(LEVELS)])
        for name, (label, wrong) in WRONG.items():
            key = f"{seed}/{name}"
            if key not in ledger.rows and not (wrong.node and case.sweep.power_node == "pcc"):
                ledger.add({"key": key, "label": name, **_answer(case, label, wrong)})
    rows = list(ledger.rows.values())
    print("| label | cases | right | median s |\n| --- | --- | --- | --- |")
    for name in WRONG:
        own = sorted((row for row in rows if row["label"] == name), key=lambda row: row["seconds"])
        if own:
            print(
                f"| {name} | {len(own)} | {sum(row['right'] for row in own)} | "
                f"{own[len(own) // 2]['seconds']:.1f} |"
            )
    return 0


def _answer(case: Case, label: str, wrong: Convention) -> dict[str, object]:
    began = time.perf_counter()
    gap = find_gap(parse_program(case.program), written_wrongly(case.sweep, wrong), case.values)
    told = {one for effect in gap.effects for one in (effect.id, *effect.indistinguishable_from)}
    right = label in told if label else gap.verdict != "data-convention"
    seconds = time.perf_counter() - began
    return {"right": right, "verdict": gap.verdict, "told": sorted(told), "seconds": seconds}


if __name__ == "__main__":
    raise SystemExit(main())
