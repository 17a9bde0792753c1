"""The sequence view: impedances by hand, a peak where a SOGI is, a resistance as dead time makes
it; else silence.
"""

from dataclasses import replace

import numpy as np
import pytest
from collecting import collecting
from ibrid_bench.hidden.hardware import draw_hardware
from made_gap import no_gap

from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.inspection_table import format_inspection
from ibrid.measurement.quality.sequence_view import sequence_view
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.report.texts.gap_text import gap_text

FREQUENCY = np.geomspace(5, 5000, 30)
W0 = 2 * np.pi * 60
J = np.array([[0.0, -1.0], [1.0, 0.0]])
#: Effects that leave no peak.
SILENT = ("delay_angle", "shunt_capacitance", "dead_time")


def winding(frequency: np.ndarray, resistance: np.ndarray, inductance: float = 0.2) -> np.ndarray:
    """(K, 2, 2) admittance of a winding, current out, with any resistance (2, 2)."""
    z = resistance + inductance * (2j * np.pi * frequency[:, None, None] / W0 * np.eye(2) + J)
    return -np.linalg.inv(z)


def test_a_winding_is_seen_at_the_frequencies_of_the_sequences():
    point = PointSweep(
        OperatingPoint("a", 1.0, 0.0), FREQUENCY, winding(FREQUENCY, 0.05 * np.eye(2))
    )
    seen = sequence_view(Sweep((point,), f0_hz=60.0)).impedance["a"]
    expected = np.stack(
        [0.05 + 0.2j * (FREQUENCY + 60) / 60, 0.05 + 0.2j * (FREQUENCY - 60) / 60], axis=1
    )
    assert np.abs(seen - expected).max() < 1e-9  # rounding of two inversions


@pytest.mark.slow
def test_a_sogi_in_the_feedforward_is_told_and_other_hardware_is_not():
    with collecting() as failures:
        for seed in range(4):
            for effect in (
                "feedforward_band_pass:add:sogi",
                "feedforward_band_pass:add:sogi_fixed",
            ):
                with failures.case(f"{effect} {seed}"):
                    told = sequence_view(draw_hardware(seed, [effect]).sweep).sentences
                    assert any("feedforward_band_pass" in one for one in told)
            for effect in SILENT:
                with failures.case(f"{effect} {seed}"):
                    assert sequence_view(draw_hardware(seed, [effect]).sweep).sentences == ()


@pytest.mark.slow
def test_what_each_sequence_sees_is_in_the_table_of_inspect_and_in_the_answer_of_a_gap():
    sweep = draw_hardware(0, ["feedforward_band_pass:add:sogi"], points=2).sweep
    found = inspect(sweep)
    assert all(point.rises[2][1] > 2 * point.rises[2][0] for point in found.points)
    text = format_inspection(found)
    assert "|Z| at 120 Hz over beside it, + and - sequence" in text
    assert "resistance along and across the current" in text
    assert "sequences   the negative sequence sees an impedance that peaks at f0" in gap_text(
        replace(no_gap(), sweep=sweep)
    )


@pytest.mark.slow
def test_a_resistance_as_dead_time_makes_it_is_told():
    points = []
    for p in (0.1, 0.3, 0.6, 1.0):
        i, r = np.array([p, 0.0]), np.hypot(p, 0.1)
        loss = 0.03 / r * (np.eye(2) - np.outer(i, i) / r**2)
        points.append(
            PointSweep(
                OperatingPoint(f"p={p}", p, 0.0),
                FREQUENCY,
                winding(FREQUENCY, 0.02 * np.eye(2) + loss),
            )
        )
    sweep = Sweep(tuple(points), f0_hz=60.0)
    (told,) = sequence_view(sweep).sentences
    assert "dead_time" in told
    assert "about 0.03 per unit" in told
    assert told in inspect(sweep).warnings


def test_the_shipped_sweeps_are_silent():
    with collecting() as failures:
        for name, path in benchmarks().items():
            with failures.case(name):
                assert sequence_view(read_sweep(path)).sentences == ()
