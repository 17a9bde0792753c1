"""One experiment at a device's terminals: settle, inject, estimate. Whatever has a terminal voltage
and a current takes it.

With u(t) a multisine, v = [v0 + u, u] in one run and [v0 + u, -u] in the next: the columns of the
voltages at a line are orthogonal, so that both axes are measured with all of the injected power,
and

    Y(f) = [I_1(f) I_2(f)] [V_1(f) V_2(f)]^-1.

Reference: Dobrowiecki, Schoukens & Guillaume, IEEE Trans. Instrum. Meas. 55, 2006 (orthogonal
multisines).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ibrid.devices.bench import DeviceBench
from ibrid.devices.multisine import Multisine
from ibrid.frozen import Frozen

#: The injected voltage of the runs on d and q, over the multisine: orthogonal columns.
RUNS = np.array([[1.0, 1.0], [1.0, -1.0]])
#: A change from period to period, of the size of the answer, that counts as none.
PERIODIC = 1e-6
#: Part to which a change must fall in a period to be a transient that still decays; what falls less
#: is noise.
DECAYING = 0.8
#: Amplitudes of the check of linearity over that of the measurement.
LARGER = 2.0
#: Error of a simulated measurement below which nobody knows it, of the size of the admittance.
KNOWN = 3e-6


@dataclass(frozen=True, eq=False)
class MeasuredResponse(Frozen):
    """admittance (K, 2, 2) and sigma (K, 2, 2) of each real and imaginary part.

    distortion : (K,) of its size, what odd powers of the amplitude change in it, 0 where noise may
    have done it. guard : (K,) of its size, what lies in bins that are not excited. periods : taken
    in all.
    """

    admittance: np.ndarray
    sigma: np.ndarray
    distortion: np.ndarray
    guard: np.ndarray
    periods: int


def measure_response(
    bench: DeviceBench,
    v0: float,
    multisine: Multisine,
    *,
    peak: float,
    repeats: int,
    most_periods: int,
    heard: Callable[[float], None] = lambda share: None,
) -> MeasuredResponse:
    """Measure the admittance of a device at rest at [v0, 0] at the lines of a multisine.

    Law of the deviation: sigma^2 = scatter of the periods + guard bins + (Y(2a) - Y(a))^2 / 9, the
    part of an odd power that grows with a^2, + `KNOWN`^2.

    Parameters
    ----------
    peak : a, per unit, that the injection on each axis reaches.
    repeats : periods that are measured, once the answer is periodic or `most_periods` are over.
    heard : is told which share is done.
    """
    levels = []
    periods = 0
    for number, amplitude in enumerate((peak, LARGER * peak)):
        spectra = []
        for run, (on_d, on_q) in enumerate(RUNS):
            wave = multisine.wave(amplitude)
            injected = on_d * wave + 1j * on_q * wave
            taken, count = _periodic(bench, v0 + injected, repeats, most_periods)
            periods += count
            spectra.append(taken)
            heard((2 * number + run + 1) / 4)
        levels.append(_estimated(multisine, spectra, amplitude))
    (admittance, scatter, guard), (larger, _, _) = levels
    size = np.linalg.norm(admittance, axis=(1, 2))
    bias = np.abs(larger - admittance) / (LARGER**2 - 1)
    known = (KNOWN * size)[:, None, None]
    sigma = np.sqrt(scatter**2 + guard[:, None, None] ** 2 + bias**2 / 2 + known**2)
    by_chance = LARGER / (LARGER**2 - 1) * np.sqrt(2 * (scatter**2 + guard[:, None, None] ** 2))
    changed, chance = (np.linalg.norm(one, axis=(1, 2)) for one in (bias, by_chance))
    distortion = np.where(changed > chance, changed, 0.0) / size
    return MeasuredResponse(admittance, sigma, distortion, 2 * guard / size, periods)


def _periodic(bench: DeviceBench, v: np.ndarray, repeats: int, most: int) -> tuple[np.ndarray, int]:
    """(repeats, N, 2) periods of the current once it is periodic, and how many were played.

    It is when a period differs from the one before by `PERIODIC`, or by no less than `DECAYING` of
    the change before: then noise is what is left.
    """
    kept: list[np.ndarray] = []
    changes = [np.inf, np.inf]
    while len(kept) < most:
        kept.append(bench.play(v))
        if len(kept) > 1:
            moving = np.linalg.norm(kept[-1] - kept[-1].mean(axis=0))
            changes.append(float(np.linalg.norm(kept[-1] - kept[-2]) / max(moving, 1e-300)))
        is_still = changes[-1] < PERIODIC or changes[-1] > DECAYING * changes[-2]
        if is_still and len(kept) >= repeats + 1:
            break
    return np.array(kept[-repeats:]), len(kept)


def _estimated(
    multisine: Multisine, runs: list[np.ndarray], peak: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean admittance (K, 2, 2), deviation of that mean from the scatter, and deviation by what the
    guard bins hold (K,).
    """
    lines = np.fft.rfft(multisine.wave(peak))[multisine.bins]
    voltage = RUNS.T[None] * lines[:, None, None]
    spectra = np.array([np.fft.rfft(periods, axis=1) for periods in runs])
    current = np.moveaxis(spectra[:, :, multisine.bins], (0, 3), (3, 2))
    single = current @ np.linalg.inv(voltage)
    admittance = single.mean(axis=0)
    spread = (np.abs(single - admittance) ** 2).sum(axis=0) / max(len(single) - 1, 1)
    scatter = np.sqrt(spread / 2 / len(single))
    held = spectra.mean(axis=1)[:, multisine.guards]
    level = np.sqrt(np.mean(np.abs(held) ** 2, axis=(0, 2, 3)))
    return admittance, scatter, level / np.abs(lines) / 2
