"""A spoilt row of a sweep is named with its mistake; a true resonance and noise are none."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from collecting import each_of

from ibrid.cli import main
from ibrid.measurement import OperatingPoint, PointSweep, Sweep, add_noise, read_sweep, write_sweep
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.row_mistakes import mended
from ibrid.measurement.quality.wrong_rows import (
    MOST,
    WrongRow,
    contradicted_rows,
    without_wrong_rows,
    wrong_rows,
)

DATA = Path(__file__).resolve().parents[2] / "data"
#: Row 9 of 16 lies at 315 Hz.
ROW = 9


def shipped(name: str) -> PointSweep:
    return read_sweep(DATA / f"{name}.csv").points[0]


def spoilt(point: PointSweep, spoil: Callable[[np.ndarray], object], row: int = ROW) -> PointSweep:
    values = np.array(point.admittance)
    values[row] = spoil(values[row])
    return replace(point, admittance=values)


def only_row(point: PointSweep) -> WrongRow:
    (row,) = wrong_rows(point)
    return row


def with_entry(
    row: int, column: int, change: Callable[[complex], complex]
) -> Callable[[np.ndarray], np.ndarray]:
    def changed(matrix: np.ndarray) -> np.ndarray:
        matrix = matrix.copy()
        matrix[row, column] = change(matrix[row, column])
        return matrix

    return changed


MISTAKES = {
    "all entries 10 times too large, a slip of the decimal point": lambda y: 10 * y,
    "all entries 10 times too small, a slip of the decimal point": lambda y: 0.1 * y,
    "all entries 1000 times too large, kilo or milli": lambda y: 1000 * y,
    "all entries 1.732 times too large, values of a phase and of a line": lambda y: np.sqrt(3) * y,
    "all entries with the other sign": lambda y: -y,
    "imaginary parts with the other sign": np.conj,
    "real and imaginary parts exchanged": lambda y: 1j * y.conj(),
    "the columns d and q exchanged": lambda y: y[:, ::-1],
    "Ydq 100 times too large, a slip of the decimal point, or percent": with_entry(
        0, 1, lambda y: 100 * y
    ),
    "real part of Ydd with the other sign": with_entry(0, 0, lambda y: complex(-y.real, y.imag)),
    "imaginary part of Yqq 10 times too large, a slip of the decimal point": with_entry(
        1, 1, lambda y: complex(y.real, 10 * y.imag)
    ),
}


@pytest.mark.slow
@each_of("likely", list(MISTAKES))
def test_a_spoilt_row_is_named_with_its_mistake(likely: str):
    point = shipped("gfm_droop")
    row = only_row(spoilt(point, MISTAKES[likely]))
    assert (row.frequency, row.likely) == (point.frequency[ROW], likely)


@pytest.mark.slow
@each_of("name", ["gfl_l_filter", "paper_like", "published_sienna_lcl"])
@each_of("row", [0, 7, 15])
def test_a_row_times_ten_is_named_wherever_it_stands(name: str, row: int):
    point = shipped(name)
    found = only_row(spoilt(point, lambda y: 10 * y, row))
    assert found.frequency == point.frequency[row]
    assert found.likely.startswith("all entries 10 times too large")


def test_a_row_that_stands_at_the_wrong_frequency_is_named():
    point = shipped("gfm_droop")
    row = only_row(spoilt(point, lambda _: point.admittance[ROW + 1]))
    assert row.likely == "like the row at 500 Hz, shifted against its frequency"


def test_a_row_without_a_likely_mistake_is_named_by_its_entries():
    row = only_row(spoilt(shipped("gfm_droop"), with_entry(0, 0, lambda y: y * (1.7 + 0.6j))))
    assert (row.entries, row.likely) == (("dd",), "")


@pytest.mark.slow
@each_of(
    "name", ["paper_like", "random_02", "random_08", "published_sting_100mva", "hybrid_gfl_gfm"]
)
@each_of("noise_db", [None, 40])
def test_resonances_and_noise_are_no_wrong_rows(name: str, noise_db: float | None):
    # the filters of these resonate between two of 16 points; at 40 dB one peak is seen by a single
    # row
    sweep = Sweep((shipped(name),))
    if noise_db is not None:
        sweep = add_noise(sweep, noise_db, rng=np.random.default_rng(0), record_sigma=False)
    assert wrong_rows(sweep.points[0]) == ()


@pytest.mark.slow
@each_of("rows", [40, 200])
def test_a_row_times_ten_is_named_in_noise_and_among_many(rows: int):
    frequency = np.geomspace(5, 5000, rows)
    x = 1j * frequency / 800
    peak, slow = x / (x**2 + x / 10 + 1), 1 / (1 + 1j * frequency / 12)
    values = np.array([[slow + peak, 0.3 * peak], [-0.2 * slow, peak - 0.7]]).transpose(2, 0, 1)
    clean = Sweep((PointSweep(OperatingPoint("a", 1, 0.3), frequency, values),))
    noisy = add_noise(clean, 30, rng=np.random.default_rng(0), record_sigma=False).points[0]
    assert wrong_rows(noisy) == ()
    assert only_row(spoilt(noisy, lambda y: 10 * y, rows // 3)).frequency == frequency[rows // 3]


def test_too_many_rows_and_too_few_are_not_looked_at():
    for rows in (8, MOST + 1):
        frequency = np.geomspace(5, 5000, rows)
        values = np.tile(np.eye(2), (rows, 1, 1)) / (1 + 1j * frequency / 300)[:, None, None]
        point = PointSweep(OperatingPoint("a", 1, 0.3), frequency, values)
        assert wrong_rows(spoilt(point, lambda y: 10 * y, 4)) == ()


def test_every_mistake_is_mended_by_its_opposite():
    row = np.array([1 + 2j, -3 + 0.5j, 0.7 - 4j, 5 - 6j])
    ways = {mistake.words: value for mistake, value in mended(row)}
    np.testing.assert_allclose(
        ways["all entries 10 times too large, a slip of the decimal point"], row / 10
    )
    np.testing.assert_allclose(ways["the axes d and q exchanged"], row[::-1])
    assert len(ways) == len(list(mended(row)))


def test_inspect_names_the_row_and_json_has_it():
    sweep = Sweep((spoilt(shipped("gfl_l_filter"), lambda y: 10 * y, 4),))
    look = inspect(sweep)
    assert "p=1,q=0.3 at 31.5 Hz: all entries 10 times too large" in look.warnings[0]
    written: Any = look.to_json()
    (told,) = written["points"][0]["wrong_rows"]
    assert (told["frequency"], told["entries"]) == (
        pytest.approx(31.5, rel=1e-2),
        ["dd", "dq", "qd", "qq"],
    )


def test_without_wrong_rows_only_these_are_left_out():
    right = shipped("gfl_l_filter")
    sweep = without_wrong_rows(
        Sweep((right, replace(spoilt(right, lambda y: -y, 4), op=OperatingPoint("b", 1, 0))))
    )
    assert [len(point.frequency) for point in sweep.points] == [16, 15]
    assert right.frequency[4] not in sweep.points[1].frequency
    assert contradicted_rows(sweep) == ()


@pytest.mark.slow
def test_a_command_warns_in_one_sentence_and_robust_leaves_the_row_out(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    file = tmp_path / "slipped.csv"
    whole = read_sweep(DATA / "gfl_l_filter.csv")
    write_sweep(
        replace(whole, points=(spoilt(whole.points[0], lambda y: 10 * y, 4), *whole.points[1:])),
        file,
    )
    options = ["gfl_l_filter", str(file), "--restarts", "0"]
    assert main(["evaluate", *options]) == 0
    warned = capsys.readouterr()
    assert warned.err.count("31.5 Hz: all entries 10 times too large") == 1
    assert warned.out.startswith("fails")
    assert main(["evaluate", *options, "--robust"]) == 0
    robust = capsys.readouterr()
    assert robust.err.startswith(
        "ibrid: left out of p=1,q=0.3: 31.5 Hz: all entries 10 times too large"
    )
    assert robust.out.startswith("explains")


def test_a_row_of_zeros_is_named():
    row = only_row(spoilt(shipped("gfl_l_filter"), lambda y: 0 * y))
    assert row.words.endswith("all entries zero, as cells that were not measured")
