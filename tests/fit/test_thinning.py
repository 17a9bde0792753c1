"""Frequencies on which the minima of a fit are looked for."""

import numpy as np
import pytest

import ibrid
from ibrid.fit.settings import FitSettings
from ibrid.fit.thinning import representative_frequencies
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep

OP = OperatingPoint("a", 0.5, 0.0, 1.0)
POINTS = (OP, OperatingPoint("b", 0.8, 0.2, 1.0))


def resonant(frequency: np.ndarray, damping: float = 1e-3) -> PointSweep:
    """A circuit with a narrow series resonance at 777 Hz."""
    ratio = frequency / 777.0
    y = 1.0 / (1.0 + 2j * damping * ratio - ratio**2) + 0.01
    return PointSweep(OP, frequency, y[:, None, None] * np.eye(2) + 1e-3)


def test_a_narrow_resonance_stays():
    frequency = np.sort(np.append(np.geomspace(2.0, 4000.0, 300), 777.0))
    kept = frequency[representative_frequencies(resonant(frequency), 24)]
    assert len(kept) == 24
    assert 777.0 in kept
    assert kept[0] == frequency[0]
    assert kept[-1] == frequency[-1]


def test_the_whole_band_stays_covered():
    frequency = np.geomspace(2.0, 4000.0, 300)
    kept = np.log10(frequency[representative_frequencies(resonant(frequency), 24)])
    assert np.diff(kept).max() < 2.0 * (kept[-1] - kept[0]) / 11


def test_few_frequencies_stay_as_they_are():
    point = resonant(np.geomspace(2.0, 4000.0, 20))
    np.testing.assert_array_equal(representative_frequencies(point, 24), np.arange(20))


def test_equal_frequencies_in_a_row_are_no_obstacle():
    point = resonant(np.linspace(100.0, 100.1, 60))
    assert len(set(representative_frequencies(point, 24))) == 24


@pytest.mark.slow
def test_the_answer_is_of_all_frequencies():
    sweep = ibrid.sweep("gfl_dc_link", POINTS, np.geomspace(2.0, 4000.0, 120))
    noisy = ibrid.add_noise(sweep, 40.0, rng=np.random.default_rng(0))
    diagram = ibrid.textbook("gfl_dc_link")
    some = ibrid.evaluate(diagram, noisy)
    every = ibrid.evaluate(diagram, noisy, settings=FitSettings(frequencies=1000))
    assert some.nrmse == pytest.approx(every.nrmse, rel=1e-4)
    for name, value in every.parameters["a"].items():
        assert some.parameters["a"][name] == pytest.approx(value, rel=1e-3), name
