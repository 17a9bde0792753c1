"""`python -m ibrid_bench.playback cost|twins`: what playback costs, and which twins records tell
apart, as tables of a page.
"""

import argparse
from pathlib import Path
from statistics import median

from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.markdown import markdown_table, write_between
from ibrid_bench.playback.cost import HEADER, INVERTERS, cost_of
from ibrid_bench.playback.twins import RECORDS, told

BEGIN, END = "<!-- made by ibrid_bench.playback {} -->", "<!-- end of {} -->"


def main() -> int:
    """Measure, print, and write the table between its marks in the page."""
    parser = argparse.ArgumentParser(prog="python -m ibrid_bench.playback", description=__doc__)
    parser.add_argument("what", choices=("cost", "twins"))
    parser.add_argument("--devices", type=int, default=20, help="of twins (20)")
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-playback"), help="folder of the results"
    )
    parser.add_argument("--page", type=Path, help="write the table between its marks in this page")
    options = parser.parse_args()
    return resumable("bench-playback", options.out, lambda: _measure(options))


def _measure(options: argparse.Namespace) -> int:
    if options.what == "cost":
        table = markdown_table(
            HEADER, sorted((cost_of(name).cells for name in INVERTERS), key=lambda row: int(row[1]))
        )
    else:
        table = _twins(Ledger(options.out), options.devices)
    print(table)
    if options.page:
        write_between(options.page, BEGIN.format(options.what), END.format(options.what), table)
    return 0


def _twins(ledger: Ledger, devices: int) -> str:
    for seed in range(devices):
        for one in told(seed, {kind for kind in RECORDS if f"{kind}/{seed}" in ledger.rows}):
            ledger.add({"key": f"{one.kind}/{seed}", **vars(one)})
            print(one, flush=True)
    rows = []
    for kind in RECORDS:
        own = [ledger.rows[f"{kind}/{seed}"] for seed in range(devices)]
        far = median(row["twin"] for row in own)
        off = [abs(row["gain"] - 1) for row in own if row["apart"]]
        gain = f"{100 * max(off):.2g} %" if off else ""
        rows.append((kind, f"{far:.1e}", f"{sum(row['apart'] for row in own)} of {devices}", gain))
    return markdown_table(
        (
            "record beside the sweep",
            "the twin is away by, median",
            "told apart",
            "its gain then off by, at most",
        ),
        rows,
    )


if __name__ == "__main__":
    raise SystemExit(main())
