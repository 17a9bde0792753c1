"""Rows as lines of a terminal and as the page docs/baselines.md."""

from collections.abc import Mapping, Sequence
from typing import Any

from ibrid_bench.baselines.answer import Row
from ibrid_bench.baselines.case import Case
from ibrid_bench.baselines.methods import METHODS
from ibrid_bench.markdown import markdown_table
from ibrid_bench.search.tables import error_words

HEADER = (
    "method",
    "fitted",
    "true there",
    "held out",
    "numbers",
    "order",
    "parameters right",
    "seconds",
    "what a reader gets",
)
_WIDTHS = (38, 9, 10, 9, 8, 8, 17, 8)
NOT_YET = "not measured yet"

_TOP = """# Other methods on the same data: black boxes, sparse regression, textbook diagrams

Made by `python -m ibrid_bench.baselines` from the rows of its ledger.

All methods get the same data: 16 frequencies from 5 Hz to 5 kHz at two operating points, p = 1 and
q = +-0.3; only "nine points measured" gets nine, p = 0.4, 0.7, 1 by q = -0.3, 0, 0.3. The operating
point p = 0.5, q = 0 is held out from all of them; the truth there is the linearised reference
inverter. At 40 dB the noise is 1 % of |Y| at every frequency and its sigma is known.

- **fitted**: NRMSE against the fitted data, mean over operating points. **true there**: against the
  clean truth at the same points; with noise, a model that fits better than this has fitted the
  noise. Where the noise is known, the error in its standard deviations is minimised, not the NRMSE
  (only the poles of vector fitting are unweighted).
- **held out**: NRMSE against the truth at the held-out operating point; for "nearest point", two
  equally near ones, the mean.
- **numbers**: free parameters of the whole model, all operating points together; cutoff frequencies
  on the grid of the library are not counted. **order**: poles or states at one operating point.
- **parameters right**: true physical parameters within 5 %. Five parameters of these inverters
  (L_F, R_F, the current control's two and the decoupling) are identifiable only up to a common
  factor, so no method can find them all from such data; `ibrid evaluate` says so.
- **seconds**: one core of a shared machine.

"""
_BOTTOM = """
## The methods

- **Vector fitting** (Gustavsen and Semlyen, 1999; poles by scikit-rf, common to the four entries;
  residues by least squares, weighted with known noise). The Bayesian information criterion chooses
  the order. The model does not depend on p and q: at another operating point one can use the
  nearest model, or a polynomial in p and q through the responses. Two points at one p contain no
  information about p. The nine points surround the held-out one, so the third row interpolates;
  outside the grid it says nothing.
- **Sparse regression** (Brunton, Proctor and Kutz, 2016; terms are dropped or added one at a time,
  their number by the same criterion). The library is written for grid-following inverters:
  constants and lags times six matrices that carry p and q as power control and PLL do, per-unit RL
  filters, resonances. "Behind the filter" first regresses the impedance at the highest frequencies
  on a library of twenty, where a sum of terms is the physics, and finds R_g, L_g and C_F if there
  are any; then it regresses what lies behind, in the frame of the capacitor voltage. So it contains
  more physics than the name suggests, and extrapolates because of it. It cannot tell which loop a
  lag comes from: closed loops multiply and divide terms, a sum does not, and the cutoff frequencies
  come from a grid.
- **White box**: `ibrid evaluate` of the diagram that made the data, and of the same without the
  low-pass before the PLL, one parameter set for both points. A wrong structure can fit to a
  fraction of a percent with wrong parameters: the error alone does not certify a diagram.
- **Search**: `ibrid.search` from the naive diagram, proposer `rules`, seed 0, without knowledge of
  structure or parameters. F1 of modules and of connections against the truth. Its answer is
  refitted as the white boxes are.

Conclusion: at the measured points a black box is as good as anything and needs no thought, though
with noise it fits some of it; it names nothing, and between operating points it is as good as the
grid of points is dense. Sparse regression extrapolates to other operating points as far as its
terms contain the operating point. A diagram has the fewest parameters, and each has a meaning, if
it is the right one; finding the right one is the task of the search.
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
    tables = "\n".join(
        f"## {case.name}\n\n{case.clean.summary}\n\n{_table(case, rows)}" for case in cases
    )
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
