"""`make demo`: fit textbook diagrams to the shipped benchmark, and to measured hardware where it lies beside the project."""

import sys
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweep import Sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.report.page import write_report
from ibrid.report.text import format_record
from ibrid.structure.library import textbook

OUT = Path("out")
PAPER = {"parameters": "per-op", "equilibrium": "paper", "vocabulary": "paper"}


def main() -> int:
    """Run the main job; 0 when every page was written."""
    try:
        OUT.mkdir(exist_ok=True)
        _benchmark()
        _hardware()
    except (IbridError, OSError) as error:
        print(f"ibrid demo: {error}", file=sys.stderr)
        return 1
    print(f"\nThe pages lie in {OUT.resolve()}; open them in a browser.")
    return 0


def _benchmark() -> None:
    sweep = read_sweep(benchmarks()["paper_like"])
    print("A simulated grid-following inverter, two operating points, 16 frequencies (data/paper_like.csv)")
    print("The paper's setting (its 23 kinds, every operating point fitted alone, equilibrium fitted):\n")
    _row("model", "NRMSE", "stable", "states", "free", "seconds", "page")
    _fit("naive", "naive", sweep, **PAPER)
    _fit("gfl_pll_filter", "true structure, paper's kinds", sweep, **PAPER)
    print("\nExact physics (equilibrium computed, one parameter set for all operating points):\n")
    _row("model", "NRMSE", "stable", "states", "free", "seconds", "page")
    _fit("naive", "naive", sweep)
    _fit("gfl_l_filter", "L filter for LCL", sweep)
    _fit("gfl", "no PLL filter, JMul", sweep)
    _fit("gfl_exact", "no PLL filter", sweep)
    best = _fit("gfl_pll_filter_exact", "true structure", sweep)
    held = evaluate(textbook("gfl_pll_filter_exact"), sweep, holdout_op=sweep.names[1])
    print(
        f"\nFitted to {sweep.names[0]} alone, {sweep.names[1]} is predicted with NRMSE {held.holdout[sweep.names[1]]:.1e}."
    )
    print("\nThe record of the true structure:\n")
    print(format_record(best))


def _hardware() -> None:
    found = hardware_sweeps()
    if "gti_pq" not in found:
        print("\nNo measured hardware beside the project; data/README.md says where to get it.")
        return
    sweep = read_sweep(found["gti_pq"])
    print(
        "\nMeasured hardware: a 400 Hz grid-tied inverter of Virginia Tech, 20 kHz digital control, two operating points\n"
    )
    _row("model", "NRMSE", "stable", "states", "free", "seconds", "page")
    _fit("gfl_l_filter", "no delay, feedforward", sweep, page="hardware_gfl_l_filter")
    shared = _fit("gfl_l_filter_delay", "delay, no feedforward", sweep, page="hardware_gfl_l_filter_delay")
    alone = evaluate(textbook("gfl_l_filter_delay"), sweep, parameters="per-op")
    print("\nNRMSE by operating point:   " + "   ".join(f"{name:>11s}" for name in sweep.names))
    for title, errors in (
        ("one shared parameter set", shared.nrmse_by_op),
        ("each point fitted alone", alone.nrmse_by_op),
        ("predicted from the other", _cross_predictions(sweep)),
    ):
        print(f"  {title:26s}" + "   ".join(f"{errors[name]:11.3f}" for name in sweep.names))


def _cross_predictions(sweep: Sweep) -> dict[str, float]:
    records = [evaluate(textbook("gfl_l_filter_delay"), sweep, holdout_op=name) for name in sweep.names]
    return {name: error for record in records for name, error in record.holdout.items()}


def _fit(name: str, title: str, sweep: Sweep, *, page: str = "", **options: Any) -> Record:
    record = evaluate(textbook(name), sweep, **options)
    file = OUT / f"{page or '_'.join(['paper' if options else 'exact', name])}.html"
    write_report(record, file, sweep=sweep)
    stable = "yes" if all(record.stable.values()) else "no"
    error = "-" if record.nrmse is None else f"{record.nrmse:.2e}" if record.nrmse < 1e-3 else f"{record.nrmse:.4f}"
    _row(title, error, stable, str(record.order), str(record.free_parameters), f"{record.seconds:.2f}", str(file))
    return record


def _row(model: str, error: str, stable: str, states: str, free: str, seconds: str, page: str) -> None:
    print(f"  {model:31s}{error:>9s}{stable:>8s}{states:>8s}{free:>6s}{seconds:>9s}  {page}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
