"""Rows of a scan at their frequencies in the dq frame: of the network less f0, and mirrored where
that is below zero.

Law: a response to real signals has Y(-f) = conj Y(f) in dq. With modified sequences, Y_pn = S Y S^H
and conj S = P S, where P exchanges p and n, that is Y_pn(-f) = P conj Y_pn(f) P. A sequence scan at
g below f0 in the network stands at f = g - f0 < 0 in dq, so it is the matrix at f0 - g, conjugated,
with p and n exchanged. Impedances obey the same law.
"""

from dataclasses import dataclass, replace

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.positive_sequence import uncoupled
from ibrid.measurement.formats.csv_table import Table
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.sweeps.quantities import counted, percent

#: Frequencies nearer than this, relatively, are one: sums and differences with f0 keep fewer digits
#: than a file has.
_NEAR = 1e-7
#: A frequency in dq this near to zero, of the largest, is none.
_ZERO = 1e-9
#: Both sides of zero may differ by this part in the median; beyond it one of their readings is
#: wrong. A side is interpolated between frequencies up to `_GAP` apart, as a factor.
DIFFERENT, _GAP = 0.3, 1.3


@dataclass(frozen=True)
class Counting:
    """At which frequency the rows of a scan are counted.

    `frame` : dq, pn (2x2 sequences) or positive (the positive sequence alone, in the first entry).
    `network` : at f + f0 instead of the dq frequency f.
    """

    frame: str
    network: bool


def in_dq(table: Table, counting: Counting, f0_hz: float, account: Account, where: str) -> Table:
    """The rows at positive dq frequencies, in the order of their runs; what was mirrored, joined or
    left out is said.

    Raises SweepError: no frequency is left, a positive sequence without partners, or both sides of
    f0 contradict each other.
    """
    shifted = counting.network and counting.frame != "positive"
    frequency = table.frequency - f0_hz if shifted else table.frequency
    zero = np.abs(frequency - f0_hz * (counting.frame == "positive")) <= _ZERO * np.abs(
        frequency
    ).max(initial=0.0)
    if zero.any():
        what = (
            f"at {f0_hz:g} Hz, which is no frequency in dq"
            if counting.network
            else "at zero frequency"
        )
        account.remark(f"left out: {counted(int(zero.sum()), 'row')} {what}")
    table = replace(table, frequency=frequency).at(~zero)
    if not len(table):
        raise SweepError(
            f"{where} must hold numbers at frequencies other than zero in dq; found none."
        )
    runs = table.grouped(_runs(table))
    if counting.frame == "positive":
        return _joined([_uncoupled(run, f0_hz, account) for run in runs])
    if (table.frequency > 0).all():
        return table
    sequence = counting.frame == "pn"
    sides = [mirrored(run, sequence=sequence) for run in runs]
    disagreement = float(np.median([side.disagreement for side in sides]))
    _say_mirrored(
        int((table.frequency < 0).sum()),
        sum(side.joined for side in sides),
        counting,
        f0_hz,
        account,
    )
    if disagreement > DIFFERENT:
        pair = f"f0 - f and f0 + f, f0 = {f0_hz:g} Hz," if shifted else "-f and f"
        exchanged = ", p and n exchanged" if sequence else ""
        raise SweepError(
            f"{where}: rows at {pair} show the same dq frequency f and must agree "
            f"(conjugated{exchanged}); found them to differ "
            f"by {percent(disagreement)}: are f0 and the frame of the frequencies right? Else "
            "leave the rows of one side out."
        )
    return _joined([side.table for side in sides])


def _say_mirrored(
    count: int, joined: int, counting: Counting, f0_hz: float, account: Account
) -> None:
    law = "their conjugate" + ", p and n exchanged," * (counting.frame == "pn")
    if counting.network:
        account.remark(
            f"{counted(count, 'row')} at g below {f0_hz:g} Hz: {law} stands at the dq frequency "
            f"{f0_hz:g} Hz - g"
        )
    else:
        account.remark(
            f"{counted(count, 'row')} at negative frequencies: {law} stands at the positive one"
        )
    if joined:
        account.remark(
            f"{counted(joined, 'dq frequency').replace('ys', 'ies')} seen from both sides: the "
            "means are taken"
        )


@dataclass(frozen=True, eq=False)
class Mirrored:
    """`table` : rows at positive frequencies. `joined` : how many stood at one frequency from both
    sides of zero.
    `disagreement` : how far both sides differ, as a part, in the median over the frequencies where
    they overlap.
    """

    table: Table
    joined: int
    disagreement: float


def mirrored(run: Table, *, sequence: bool) -> Mirrored:
    """Every row at the magnitude of its dq frequency; two that meet there, from both sides of zero,
    become their mean.

    run : rows at dq frequencies of either sign, each once, none zero. sequence : whether they hold
    modified sequences.
    """
    below = run.frequency < 0
    matrix, sigma = run.matrix.copy(), run.sigma.copy()
    turned = matrix[below][:, ::-1, ::-1] if sequence else matrix[below]
    matrix[below] = turned.conj()
    if sequence and sigma.shape[1] == 4:
        sigma[below] = sigma[below][:, ::-1]
    size = np.abs(run.frequency)
    disagreement = _disagreement(size[below], matrix[below], size[~below], matrix[~below])
    order = np.argsort(size, kind="stable")
    first, second = order[:-1], order[1:]
    meet = (size[second] - size[first] <= _NEAR * size[second]) & (below[first] != below[second])
    first, second = first[meet], second[meet]
    matrix[first] = (matrix[first] + matrix[second]) / 2
    sigma[first] = np.hypot(sigma[first], sigma[second]) / 2
    kept = np.setdiff1d(np.arange(len(size)), second)
    table = replace(run, frequency=size, matrix=matrix, sigma=sigma).at(kept)
    return Mirrored(table, int(meet.sum()), disagreement)


def _uncoupled(run: Table, f0_hz: float, account: Account) -> Table:
    """A scan of the positive sequence alone in dq, without coupling; rows without a partner are
    left out.
    """
    run = run.at(run.frequency > 0)
    frequency, matrix, rows = uncoupled(run.frequency, run.matrix[:, 0, 0], f0_hz)
    of_both = len(np.unique(np.round(np.abs(run.frequency - f0_hz), 6)))
    if len(frequency) < of_both:
        account.remark(
            f"left out: {of_both - len(frequency)} of {of_both} dq frequencies: each joins f0 + f "
            f"and |f0 - f|, f0 = {f0_hz:g} "
            "Hz, which must both be within the scan"
        )
    return replace(run.at(rows), frequency=frequency, matrix=matrix)


def _runs(table: Table) -> np.ndarray:
    """A number for each row: alike where operating point, repeat and the rank of the amplitude at
    its frequency are.
    """
    rank, seen = np.zeros(len(table), dtype=int), {}
    for k in np.argsort(np.nan_to_num(table.amplitude), kind="stable"):
        key = table.op[k], table.repeat[k], table.frequency[k]
        rank[k] = seen[key] = seen.get(key, -1) + 1
    numbers: dict[tuple, int] = {}
    keys = zip(table.op.tolist(), table.repeat.tolist(), rank.tolist(), strict=True)
    return np.array([numbers.setdefault(key, len(numbers)) for key in keys])


def _joined(tables: list[Table]) -> Table:
    return Table(
        **{name: np.concatenate([vars(one)[name] for one in tables]) for name in vars(tables[0])}
    )


def _disagreement(
    frequency: np.ndarray, mirror: np.ndarray, other_frequency: np.ndarray, other: np.ndarray
) -> float:
    """Median over the mirrored rows of |their matrix less that of the other side| over its size;
    the other side interpolated.
    """
    order = np.argsort(other_frequency)
    grid, values = other_frequency[order], other[order]
    differences = []
    for f, matrix in zip(frequency, mirror, strict=True):
        k = int(np.searchsorted(grid, f * (1 - _NEAR)))
        if k < len(grid) and grid[k] <= f * (1 + _NEAR):
            beside = values[k]
        elif 0 < k < len(grid) and grid[k] <= _GAP * grid[k - 1]:
            part = (f - grid[k - 1]) / (grid[k] - grid[k - 1])
            beside = (1 - part) * values[k - 1] + part * values[k]
        else:
            continue
        differences.append(np.linalg.norm(matrix - beside) / max(np.linalg.norm(beside), 1e-300))
    return float(np.median(differences)) if differences else 0.0
