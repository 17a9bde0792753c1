"""`python -m ibrid_bench.devices --out OUT [--page PAGE]`: what is reached on devices that somebody
else built.

The last operating point is held out. Each device by vector fits of its points, its best shipped
diagram (`ibrid start`), a search from the defaults, and the gap from the best shipped diagram; what
is in OUT already is not measured again.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.markdown import markdown_table
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.running import search
from ibrid_search.starting.start import start
from ibrid_search.step import line

from ibrid.evaluation.errors_by_part import nrmse
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.grade import misfit_of
from ibrid.evaluation.record import Record
from ibrid.gap.workflow import find_gap
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.measurement.sweeps.vector_fit import best_fit
from ibrid.structure.diagrams.library import textbook
from ibrid.study import Study

#: Evaluations of a search at most.
BUDGET = 40
DATA = Path(__file__).resolve().parents[2] / "data" / "devices"
Row = dict[str, Any]
HEAD = """# Devices built by others

Made by `python -m ibrid_bench.devices`. NRMSE, one parameter set for all fitted points; the last operating point is
held out. `gti_*`: measured on Virginia Tech's bench inverter, `first labelled` with p and q sqrt 2 too large
(`data/README.md`). `motulator_*`: sampled control of the package motulator, measured by injection
(`ibrid.plants.motulator_bridge`). Vector fits have separate values at every point and predict no other.

"""


def devices() -> dict[str, Path]:
    """Name -> sweep, of those that are on this machine."""
    measured = hardware_sweeps()
    first = {
        f"{name}, first labelled": path.parent / "as_first_labelled" / path.name
        for name, path in measured.items()
    }
    simulated = {path.stem: path for path in sorted(DATA.glob("*.csv"))}
    return {
        **measured,
        **{name: path for name, path in first.items() if path.is_file()},
        **simulated,
    }


def _vector_fit(sweep: Sweep, held: Sequence[str]) -> Row:
    points = sweep.without(held).points
    fits = [best_fit(point.frequency, point.admittance) for point in points]
    floor = misfit_of([point.admittance for point in points], points, 0)["floor"]
    orders = sorted({fit.order for fit in fits})
    errors = [nrmse(fit.response, point) for fit, point in zip(fits, points, strict=True)]
    answer = f"{orders[0]} to {orders[-1]} poles" if len(orders) > 1 else f"{orders[0]} poles"
    return {
        "error": float(np.mean(errors)),
        "floor": floor["value"],
        "from": floor["from"],
        "answer": answer,
    }


def _shipped(sweep: Sweep, held: Sequence[str]) -> Row:
    best = start(sweep.without(held), tell=lambda words, share: None).best
    return {**_of(evaluate(textbook(best.diagram), sweep, holdout_op=held)), "answer": best.diagram}


def _searched(sweep: Sweep, held: Sequence[str]) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        run = search(
            Study.of(sweep, holdout_op=held, labels="uncertain"),
            Path(folder) / "run",
            budget=BUDGET,
            progress="silent",
        )
        record = run.best
        assert record is not None
        with Store.open(run.folder / ARCHIVE, read_only=True) as store:
            steps = {step.number: step for step in store.steps()}
        way = "; ".join(step.note for step in line(steps, run.selection["answer"]))
        return {
            **_of(record),
            "answer": f"{way}; {record.free_parameters} numbers, {run.ending}",
            "labels": _labels(record),
            "program": record.program,
            "parameters": dict(record.parameters),
        }


def _gap(sweep: Sweep, held: Sequence[str]) -> Row:
    best = start(sweep.without(held), tell=lambda words, share: None).best
    gap = find_gap(textbook(best.diagram), sweep, holdout_op=held, progress="silent")
    named = " + ".join(one.id for one in gap.effects)
    return {
        **_of(gap.repaired),
        "answer": f"{gap.verdict}{': ' if named else ''}{named} from {best.diagram}",
    }


METHODS: Mapping[str, Callable[[Sweep, Sequence[str]], Row]] = {
    "vector fits": _vector_fit,
    "best shipped diagram": _shipped,
    "search": _searched,
    "gap": _gap,
}


def _of(record: Record) -> Row:
    held = list(record.holdout.values())
    return {
        "error": record.nrmse,
        "held": float(np.mean(held)) if held else None,
        "grade": record.grade,
    }


def _labels(record: Record) -> list[str]:
    return [one["id"] for one in record.labels]


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done, 1: Ctrl-C, 2: the options or the folder were wrong."""
    parser = argparse.ArgumentParser(prog="python -m ibrid_bench.devices", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="where the page is written")
    parser.add_argument(
        "--only", help="devices whose names begin so; '' for the page of what is there"
    )
    options = parser.parse_args(arguments)
    return resumable("bench-devices", options.out, lambda: _benchmark(options))


def _benchmark(options: argparse.Namespace) -> int:
    ledger = Ledger(options.out)
    for name, path in devices().items():
        sweep = read_sweep(path)
        held = sweep.names[-1:] if len(sweep.names) > 1 else ()
        for method, measure in METHODS.items():
            key = f"{name}/{method}"
            wanted = options.only is None or (options.only and name.startswith(options.only))
            if wanted and key not in ledger.rows:
                ledger.add({"key": key, "device": name, "method": method, **measure(sweep, held)})
    page = HEAD + table(ledger.rows)
    print(page)
    if options.page:
        options.page.write_text(page, encoding="utf-8")
    return 0


def table(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each device and method, with the noise floor of the device; what is in no row was
    not measured.
    """
    names = dict.fromkeys(row["device"] for row in rows.values())
    floors = {
        row["device"]: f"{row['floor']:.2g} ({row['from']})"
        for row in rows.values()
        if "floor" in row
    }
    cells = []
    for name, method in product(names, METHODS):
        row = rows.get(f"{name}/{method}", {"answer": "not measured yet"})
        numbers = ["-" if row.get(one) is None else f"{row[one]:.3g}" for one in ("error", "held")]
        told = row["answer"] + (
            f"; labels: {', '.join(row['labels'])}" if row.get("labels") else ""
        )
        cells.append((name, method, *numbers, row.get("grade") or "-", floors.get(name, "-"), told))
    return markdown_table(
        ("device", "by", "error", "held out", "grade", "noise floor", "answer"), cells
    )


if __name__ == "__main__":
    sys.exit(main())
