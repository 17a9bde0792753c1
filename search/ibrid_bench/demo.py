"""`make demo`: find the hidden controller of the shipped benchmark by search; then measured
hardware, where it lies near.
"""

import os
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.read import read_sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.report.pages.page import write_report
from ibrid.report.texts.text import format_record
from ibrid.structure.comparison.compare import compare, format_comparison
from ibrid.structure.diagrams.library import textbook

OUT = Path("out")
RUN = OUT / "search"
TRUTH = "gfl_pll_filter_exact"
#: Where the search begins: two layers away from it.
START = "gfl_l_filter"


def main() -> int:
    """Run the main job; 0 when every page was written."""
    try:
        OUT.mkdir(exist_ok=True)
        pages = [_search(), *_hardware()]
    except (IbridError, OSError) as error:
        print(f"ibrid demo: {error}", file=sys.stderr)
        return 1
    print("\nOpen in a browser:")
    for page in pages:
        print(f"  {page.resolve()}")
    return 0


def _search() -> Path:
    """As `ibrid search paper_like --out out/search --start gfl_l_filter --truth
    gfl_pll_filter_exact` does.
    """
    from ibrid_search.running import search  # on top of ibrid, like the command line

    sweep = read_sweep(benchmarks()["paper_like"])
    print(
        "A simulated grid-following inverter, measured at its terminals: two operating points, 16 "
        "frequencies\n"
        "(data/paper_like.csv). The search begins with the control of a plain L filter and has the "
        "data alone.\n",
        flush=True,
    )
    if RUN.is_dir():
        shutil.rmtree(RUN)
    workers = (os.cpu_count() or 1) if find_spec("ray") is not None else 1
    run = search(
        sweep, RUN, start=textbook(START), workers=workers, truth=textbook(TRUTH), progress="auto"
    )
    print(f"\n{run.evaluations} evaluations in {run.seconds:.0f} s; {run.ending}.")
    if run.best is None:
        raise IbridError("the search found no valid candidate; see out/search/report.html")
    print("\nThe diagram that was found:\n")
    print(run.best.program)
    print("Compared with the hidden one:\n")
    print(format_comparison(compare(run.best.diagram, textbook(TRUTH))))
    print("\nIts record:\n")
    print(format_record(run.best))
    return RUN / "report.html"


def _hardware() -> list[Path]:
    found = hardware_sweeps()
    if "gti_pq" not in found:
        return []
    sweep = read_sweep(found["gti_pq"])
    print(
        "\nMeasured hardware: a 400 Hz inverter of Virginia Tech, textbook diagrams fitted to two "
        "operating points\n"
    )
    pages = []
    for name, title in (
        ("gfl_l_filter", "no delay, feedforward"),
        ("gfl_l_filter_delay", "delay, no feedforward"),
    ):
        record = evaluate(textbook(name), sweep)
        pages.append(write_report(record, OUT / f"hardware_{name}.html", sweep=sweep))
        print(f"  {title:25s} NRMSE {record.nrmse:.3f}")
    return pages


if __name__ == "__main__":
    sys.exit(main())
