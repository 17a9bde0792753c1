"""`make attack`: the table of docs/trust.md, by attacking what is installed here; loopback and
temporary folders alone.

python -m ibrid_bench.attack [--only WORD] [--minutes 20] [--page docs/trust.md]
"""

import argparse
import re
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from ibrid_bench.attack.attacks import ATTACKS, Row, rows_of

BEGIN, END = "<!-- made by make attack -->", "<!-- end -->"
#: It waits for processes most of its time, so it runs beside the others.
BESIDE = "kills"


def _told(rows: list[Row]) -> list[Row]:
    for row in rows:
        print(row.cells, flush=True)
        for sentence in (*row.failed, *row.lost):
            print(f"  {sentence}", file=sys.stderr)
    return rows


def main() -> int:
    """Attack, print, write the page; 1 when something failed or was lost."""
    parser = argparse.ArgumentParser(prog="python -m ibrid_bench.attack")
    parser.add_argument("--only", choices=tuple(ATTACKS), help="one of them alone")
    parser.add_argument("--minutes", type=float, default=20.0, help="for all of it (20)")
    parser.add_argument("--page", type=Path, help="write the table between its marks in this page")
    arguments = parser.parse_args()
    chosen = [arguments.only] if arguments.only else list(ATTACKS)
    end, rows = time.monotonic() + 60 * arguments.minutes, []
    beside = [
        name for name in chosen if name == BESIDE
    ]  # which waits for processes most of its time
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as lane:
        waited = [lane.submit(rows_of, name, end) for name in beside]
        in_turn = [name for name in chosen if name not in beside]
        for left, name in zip(range(len(in_turn), 0, -1), in_turn, strict=True):
            rows += _told(rows_of(name, time.monotonic() + (end - time.monotonic()) / left))
        for answer in waited:
            rows += _told(answer.result())
    if arguments.page and not arguments.only:
        table = "\n".join(
            [
                "| attack | tried | failed | lost |",
                "| --- | --- | --- | --- |",
                *(row.cells for row in rows),
            ]
        )
        text = arguments.page.read_text(encoding="utf-8")
        marked = re.compile(f"{re.escape(BEGIN)}.*{re.escape(END)}", re.DOTALL)
        arguments.page.write_text(
            marked.sub(lambda _: f"{BEGIN}\n{table}\n{END}", text), encoding="utf-8"
        )
    return int(any(row.failed or row.lost for row in rows))


if __name__ == "__main__":
    sys.exit(main())
