"""The injected voltage: whole periods, odd bins, none on another's image, a low peak."""

import numpy as np
import pytest
from collecting import each_of

from ibrid.devices.multisine import multisine_for
from ibrid.errors import SweepError
from ibrid.plants.sweeping import frequency_grid

#: (frequencies, step in s, nominal frequency).
CASES = [
    ("5:2000:40", 1e-4, 50.0),
    ("1:400:16", 1e-3, 60.0),
    ("10:4000:60", 1e-5, 60.0),
    ("50:50:1", 2e-4, 50.0),
]


@each_of(("text", "step_s", "f0_hz"), CASES)
def test_lines_are_odd_bins_of_whole_periods_near_what_is_asked(
    text: str, step_s: float, f0_hz: float
):
    asked = frequency_grid(text)
    multisine = multisine_for(asked, step_s, f0_hz)
    period = multisine.samples * step_s
    assert len(multisine.bins) == len(asked)
    assert (multisine.bins % 2 == 1).all()
    assert period * f0_hz == pytest.approx(round(period * f0_hz), abs=1e-9)
    # three bins aside at most
    assert np.abs(multisine.frequency - asked).max() < 5 / period


@each_of(("text", "step_s", "f0_hz"), CASES)
def test_the_spectrum_is_the_lines_and_nothing_else(text: str, step_s: float, f0_hz: float):
    multisine = multisine_for(frequency_grid(text), step_s, f0_hz)
    wave = multisine.wave(0.01)
    lines = 2 * np.abs(np.fft.rfft(wave)) / multisine.samples
    assert np.abs(wave).max() == pytest.approx(0.01)
    np.testing.assert_allclose(lines[multisine.bins], multisine.line_amplitude(0.01), rtol=1e-9)
    lines[multisine.bins] = 0.0
    assert lines.max() < 1e-14
    assert not set(multisine.guards.ravel()) & set(multisine.bins)
    assert (multisine.guards % 2 == 1).all()


def test_no_line_lies_on_an_image_or_an_alias_of_another():
    multisine = multisine_for(np.arange(80.0, 420.0, 10.0), 1e-3, 50.0)
    twice, rate = (round(hz * multisine.samples * 1e-3) for hz in (100.0, 1000.0))
    lines = set(multisine.bins.tolist())
    images = {
        image for line in lines for image in (line + twice, line - twice, twice - line, rate - line)
    }
    assert len(lines) == 34
    assert not lines & images


def test_the_peak_is_lower_than_with_phases_by_chance():
    multisine = multisine_for(frequency_grid("5:2000:40"), 1e-4, 50.0)
    rng = np.random.default_rng(1)
    peaks = []
    for _ in range(20):
        spectrum = np.zeros(multisine.samples // 2 + 1, dtype=complex)
        spectrum[multisine.bins] = np.exp(2j * np.pi * rng.random(len(multisine.bins)))
        peaks.append(
            np.abs(np.fft.irfft(spectrum, multisine.samples)).max() * multisine.samples / 2
        )
    assert 1 / multisine.line_amplitude(1.0) < min(peaks)


def test_frequencies_that_the_sampling_does_not_show_are_refused():
    with pytest.raises(
        SweepError,
        match=r"must lie below 4500 Hz, 0\.45 of the device's sampling rate of 10000 Hz; found 5000",
    ):
        multisine_for([50.0, 5000.0], 1e-4, 50.0)
    with pytest.raises(SweepError, match=r"need a period of 1e[+]06 s"):
        multisine_for([1.0, 1.000002], 1e-4, 50.0)
