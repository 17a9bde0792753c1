"""`python -m ibrid_bench.real_sizes.sensitivity`: what each setting of a fit is worth.

Each number of `FitSettings` is halved and doubled by itself, on ten inputs of three families, five
with the true structure and five with a wrong one, where local minima abound. A line says the error
over that of the defaults, worst and median of the ten, and the responses evaluated over theirs,
which unlike seconds depend on no machine. `--page` writes the table between its marks.
"""

import argparse
import statistics
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.markdown import markdown_table, write_between
from ibrid_bench.real_sizes.jobs import Measured

import ibrid
from ibrid.errors import IbridError
from ibrid.fit.settings import FitSettings

BEGIN, END = "<!-- made by ibrid_bench.real_sizes.sensitivity -->", "<!-- end of sensitivity -->"
DEFAULTS = "as they are"
#: The data, and the diagram that is fitted.
CASES = (
    (Measured("paper_like", 3, 60, 50.0), "gfl_pll_filter_exact"),
    (Measured("gfl_dc_link", 2, 48, 50.0), "gfl_dc_link"),
    (Measured("gfm_droop", 3, 60, 50.0), "gfm_droop"),
    (Measured("gfm_vsm", 2, 48, 50.0), "gfm_vsm"),
    (Measured("hybrid_gfl_gfm", 3, 60), "hybrid_gfl_gfm"),
    (Measured("paper_like", 2, 48, 50.0), "gfl_l_filter"),
    (Measured("gfl_dc_link", 2, 48, 50.0), "gfl_pll_filter_exact"),
    (Measured("gfm_vsm", 2, 48, 50.0), "gfm_droop"),
    (Measured("gfm_dvoc", 2, 48, 50.0), "gfm_droop"),
    (Measured("hybrid_gfl_gfm", 2, 48, 50.0), "gfm_dvoc"),
)


@dataclass(frozen=True)
class Change:
    """A setting that is multiplied by a factor; no setting: the defaults."""

    setting: str = ""
    factor: float = 1.0

    def __str__(self) -> str:
        return f"{self.setting} x {self.factor:g}" if self.setting else DEFAULTS

    def settings(self) -> FitSettings:
        """The defaults with this changed."""
        if not self.setting:
            return FitSettings()
        value = getattr(FitSettings(), self.setting)
        changed = value * self.factor
        return replace(
            FitSettings(),
            **{self.setting: max(1, round(changed)) if isinstance(value, int) else changed},
        )


def changes() -> Iterator[Change]:
    """The defaults, then each number halved and doubled."""
    yield Change()
    for field in fields(FitSettings):
        if isinstance(getattr(FitSettings(), field.name), int | float):
            yield from (Change(field.name, factor) for factor in (0.5, 2.0))


def main() -> int:
    """Measure what is missing in --out, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/bench-sensitivity"))
    parser.add_argument("--page", type=Path, help="write the table between its marks in this page")
    options = parser.parse_args()
    return resumable("bench-sensitivity", options.out, lambda: _measure(options))


def _measure(options: argparse.Namespace) -> int:
    ledger = Ledger(options.out)
    for number, (measured, diagram) in enumerate(CASES):
        sweep = measured.sweep()
        for change in changes():
            key = f"{number}/{change}"
            if key not in ledger.rows:
                record = ibrid.evaluate(ibrid.textbook(diagram), sweep, settings=change.settings())
                work = record.starts["evaluations"]
                ledger.add({"key": key, "error": record.nrmse, "work": work})
    table = table_of(ledger)
    print(table)
    if options.page:
        write_between(options.page, BEGIN, END, table)
    return 0


def table_of(ledger: Ledger) -> str:
    """A row for each change: errors and responses over those of the defaults."""
    rows = []
    for change in changes():
        if not change.setting:
            continue
        own = [ledger.rows[f"{number}/{change}"] for number in range(len(CASES))]
        usual = [ledger.rows[f"{number}/{Change()}"] for number in range(len(CASES))]
        errors = [
            _ratio(one["error"], other["error"]) for one, other in zip(own, usual, strict=True)
        ]
        work = sum(one["work"] for one in own) / sum(one["work"] for one in usual)
        worse = sum(ratio > 1.01 for ratio in errors)
        better = sum(ratio < 0.99 for ratio in errors)
        rows.append(
            (
                f"`{change.setting}` x {change.factor:g}",
                f"{statistics.median(errors):.3f}",
                f"{max(errors):.3f}",
                str(worse),
                str(better),
                f"{work:.2f}",
            )
        )
    head = ("setting", "error, median", "worst", "worse by 1 %", "better by 1 %", "responses")
    return markdown_table(head, rows)


def _ratio(error: float | None, usual: float | None) -> float:
    """Errors of two fits; both exact counts as equal."""
    if error is None or usual is None:
        raise IbridError("a fit of the table has no result; delete the folder and measure anew")
    exact = 1e-9
    return max(error, exact) / max(usual, exact)


if __name__ == "__main__":
    raise SystemExit(main())
