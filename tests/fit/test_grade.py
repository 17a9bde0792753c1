"""The grade of a model: chi-square of what is left over against the noise that the data tell."""

from dataclasses import replace

import numpy as np
import pytest
from fitted import benchmark, evaluated

import ibrid
from ibrid.evaluation.grade import Grade, grade_of, misfit_of
from ibrid.gap.recordings.evaluation_record import grade_recordings
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid.report.facts.verdict import verdict
from ibrid.report.texts.text import format_record


def _noisy(level: float, seed: int, stated: float = 1.0) -> PointSweep:
    """White noise on ones; `stated` : the deviation said over the true one."""
    rng = np.random.default_rng(seed)
    noise = level * (rng.normal(size=(40, 2, 2)) + 1j * rng.normal(size=(40, 2, 2)))
    point = benchmark().points[0]
    return PointSweep(
        point.op, np.geomspace(5, 5e3, 40), 1 + noise, sigma=np.full((40, 2, 2), stated * level)
    )


def _of(point: PointSweep, free: int = 0) -> tuple[Grade, dict]:
    response = np.ones_like(point.admittance)
    misfit = misfit_of([response], [point], free)
    error = np.linalg.norm(response - point.admittance) / np.linalg.norm(point.admittance)
    return grade_of(float(error), misfit), misfit


def test_noise_alone_is_explained_as_often_as_the_threshold_says():
    grades = [_of(_noisy(0.01, seed))[0] for seed in range(200)]
    assert grades.count(Grade.EXPLAINS) >= 198  # p > 1e-3: 0.2 of 200 in the mean


def test_chi_square_is_that_of_the_residual_over_the_stated_noise():
    point = _noisy(0.01, 1)
    square = (np.abs((1 - point.admittance) / 0.01) ** 2).sum()
    assert _of(point, free=20)[1]["chi2_per_dof"] == pytest.approx(square / (320 - 20), rel=1e-12)
    assert _of(point)[1]["floor"] == {
        "value": pytest.approx(0.01 * np.sqrt(2), rel=0.05),
        "from": "sigma",
    }


@pytest.mark.parametrize(("stated", "grade"), [(1.0, "explains"), (0.6, "close"), (0.3, "rough")])
def test_what_is_left_over_is_measured_in_noise_floors(stated: float, grade: str):
    assert (
        _of(_noisy(0.01, 2, stated))[0] == grade
    )  # left over sqrt(1/stated^2 - 1): 0, 1.3 and 3.2 floors


def test_a_large_error_fails_unless_the_noise_is_as_large():
    assert _of(_noisy(0.3, 3, 0.1))[0] == Grade.FAILS
    assert _of(_noisy(0.3, 3))[0] == Grade.EXPLAINS


def test_a_part_that_stands_out_is_named_and_no_other():
    point = _noisy(0.01, 4)
    wrong = np.array(point.admittance)
    wrong[point.frequency < 50, 0, 1] += 0.05
    parts = _of(replace(point, admittance=wrong))[1]["by_entry_band"]
    assert [(part["entry"], part["band"]) for part in parts] == [("dq", "5-50")]
    assert parts[0]["z"] > 5


def test_as_many_free_numbers_as_measured_say_nothing():
    point = _noisy(0.01, 5)
    grade, misfit = _of(point, free=320)
    assert misfit["chi2_per_dof"] is None
    assert grade == Grade.ROUGH


@pytest.mark.slow
def test_data_of_unknown_noise_are_judged_by_a_ten_thousandth_of_their_size():
    right, wrong = evaluated("gfl_pll_filter_exact", restarts=0), evaluated("gfl_delay", restarts=0)
    assert (right.grade, right.misfit["floor"]["from"]) == ("explains", "unknown")
    assert right.misfit["floor"]["value"] == pytest.approx(1e-4, rel=1e-6)
    assert wrong.grade in ("rough", "fails")


@pytest.mark.slow
def test_a_model_of_records_that_is_worse_than_none_fails_however_large_its_floor():
    assert grade_recordings(2.0, 8.0, adequate=True) == Grade.FAILS
    assert grade_recordings(2.0, 8.0, adequate=False) == Grade.FAILS
    assert grade_recordings(0.3, 0.36, adequate=True) == Grade.EXPLAINS
    assert grade_recordings(0.3, 0.2, adequate=False) == Grade.CLOSE
    assert grade_recordings(0.09, 0.01, adequate=False) == Grade.ROUGH
    assert grade_recordings(0.3, 0.01, adequate=False) == Grade.FAILS


def test_text_leads_with_the_grade_and_never_says_ok():
    for name in ("naive", "gfl_pll_filter_exact"):
        record = evaluated(name, restarts=0)
        assert format_record(record).startswith(f"{record.grade}: {verdict(record)[:40]}")


@pytest.mark.slow
def test_repeats_tell_the_noise_too():
    noisy = ibrid.add_noise(
        benchmark(), 50.0, rng=np.random.default_rng(1), repeats=6, record_sigma=False
    )
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), noisy, restarts=0)
    assert record.misfit["floor"]["from"] == "repeats"
    assert record.grade == "explains"
