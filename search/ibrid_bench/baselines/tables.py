"""Rows as lines of a terminal and as the page docs/baselines.md."""

from collections.abc import Mapping, Sequence
from typing import Any

from ibrid_bench.baselines.answer import Row
from ibrid_bench.baselines.case import Case
from ibrid_bench.baselines.methods import METHODS
from ibrid_bench.markdown import markdown_table
from ibrid_bench.search.tables import error_words

HEADER = (
    "method", "fitted", "true there", "held out", "numbers", "order", "parameters right", "seconds", "what a reader gets",
)  # fmt: skip
_WIDTHS = (38, 9, 10, 9, 8, 8, 17, 8)
NOT_YET = "not measured yet"

_TOP = """# Black boxes, sparse regression and textbook diagrams beside the search

Made by `python -m ibrid_bench.baselines`, which keeps what it has measured and goes on where it was stopped.

All methods get the same data: 16 frequencies from 5 Hz to 5 kHz at two operating points, p = 1 and q = +-0.3; only "nine
points measured" gets nine, p = 0.4, 0.7, 1 by q = -0.3, 0, 0.3. The operating point p = 0.5, q = 0 is held out from all of them;
the truth there is the linearised reference inverter. At 40 dB the noise is 1 % of |Y| at every frequency and its sigma is known.

- **fitted**: NRMSE against the data that were fitted, mean over operating points. **true there**: against the clean truth at
  the same points; with noise, a model that fits better than it is true has fitted the noise. Where the noise is known, the
  error is minimised in its standard deviations, not as NRMSE (only the poles of vector fitting come unweighted).
- **held out**: NRMSE against the truth at the held-out operating point; for "nearest point", two equally near ones, the mean.
- **numbers**: free numbers of the whole model, all operating points together; corners that a term takes from the grid of the
  library are not counted. **order**: poles or states at one operating point.
- **parameters right**: true physical parameters within 5 %. Of the parameters of these inverters five (L_F, R_F, the current
  control's two and the decoupling) scale together without any effect at the terminals, so that no method can get them
  all from such data; `ibrid evaluate` says so.
- **seconds**: one core of a shared machine.

"""
_BOTTOM = """
## The methods

- **Vector fitting** (Gustavsen and Semlyen, 1999; poles by scikit-rf, common to the four entries; residues by least squares
  weighted with the noise where it is known). The order is the one that the Bayesian information criterion chooses. Nothing
  in the model knows p and q: at another operating point one can take the nearest model, or a polynomial in p and q through the
  responses. Two points at one p say nothing about p. The nine points surround the held-out one, which is all that makes the third
  row good: it interpolates, and it has nothing to say outside the grid.
- **Sparse regression** (Brunton, Proctor and Kutz, 2016; terms are dropped or added one at a time, their number by the
  same criterion). The library is written for grid-following inverters: constants and lags times six matrices that carry p and
  q the way power control and PLL do, per-unit RL filters, resonances. "Behind the filter" first regresses the impedance
  at the highest frequencies on a library of twenty, where a sum of terms is the physics, and finds R_g, L_g and C_F if there are
  any; then it regresses what lies behind, in the frame of the capacitor voltage. So it gets more physics from us than the name
  promises, and extrapolates because of it. What it cannot say is which loop a lag comes from: closing loops
  multiplies and divides terms, a sum does neither, and the corners of the lags come from a grid.
- **White box**: `ibrid evaluate` of the diagram that made the data, and of the same without the low-pass before the PLL, one
  parameter set for both points. A wrong structure can fit to a fraction of a percent while its parameters are wrong: the error
  alone does not certify a diagram.
- **Search**: `ibrid.search` from the naive diagram, proposer `rules`, seed 0; it knows neither the structure nor the
  parameters. F1 is that of modules and of connections against the truth. Its answer is fitted anew as the white boxes are.

What this says about the argument of the paper: at the points that were measured a black box is as good as anything and needs
no thought, though with noise it fits some of that too; it names nothing, and between operating points it is as good as the grid
of points is dense. Sparse regression carries over to other operating points as far as somebody put the operating point into
its terms. A diagram has the fewest numbers, and each of them means something, if it is the right one; which one is right is
what the search is for.
"""


def heading() -> str:
    """The columns of `line`."""
    return _aligned(HEADER[:-1]) + f"  {HEADER[-1]}"


def line(row: Row) -> str:
    """A row for the terminal."""
    *cells, reader = cells_of(row)
    return f"{_aligned(cells)}  {reader}"


def cells_of(row: Row) -> tuple[str, ...]:
    """The cells of a row, in the order of `HEADER`."""
    right = "none" if row["recovered"] is None else f"{row['recovered']} of {row['of']}"
    return (
        METHODS[row["method"]].title,
        *(error_words(row[name]) for name in ("fitted", "true", "held_out")),
        str(row["parameters"]),
        row["order"],
        right,
        f"{row['seconds']:.1f}",
        row["reader"],
    )


def page(cases: Sequence[Case], rows: Mapping[tuple[Case, str], Mapping[str, Any]]) -> str:
    """Markdown: a table for each case, each with all methods; rows that are missing say so."""
    tables = "\n".join(f"## {case.name}\n\n{case.clean.summary}\n\n{_table(case, rows)}" for case in cases)
    return f"{_TOP}{tables}{_BOTTOM}"


def _table(case: Case, rows: Mapping[tuple[Case, str], Mapping[str, Any]]) -> str:
    lines: list[tuple[str, ...]] = []
    for name, method in METHODS.items():
        row = rows.get((case, name))
        blank = (method.title, *["-"] * (len(HEADER) - 2), NOT_YET)
        lines.append(blank if row is None else cells_of(dict(row)))
    return markdown_table(HEADER, lines)


def _aligned(cells: Sequence[str]) -> str:
    first, *rest = zip(cells, _WIDTHS, strict=True)
    return f"{first[0]:{first[1]}}" + " ".join(f"{cell:>{width}}" for cell, width in rest)
