"""What the highest frequencies say of the nominal frequency f0, whatever the file says of it.

Law: a filter knows no dq frame. Its impedance g is one of the frequency in the network, so at f in
dq the positive sequence sees g(f + f0) and the negative one g(f - f0):

    S = (Zdd + Zqq)/2 = (g(f + f0) + g(f - f0))/2,
    N = (Zqd - Zdq)/2 = (g(f + f0) - g(f - f0))/2j.

For an inductance N/S = f0/(j f). Control in dq is the same for both sequences: feedforward divides
S and N alike, a current controller adds to S alone. The sign of N is the side of the q axis;
current, base and a turned frame change nothing. Decoupling without delay takes from N what a lower
f0 would: what it leaves reads as another f0.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from ibrid.measurement.conventions.rotation import propagate
from ibrid.measurement.sweeps.noise import PointNoise, estimate, estimate_point
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: Hz: nominal frequencies of grids and aircraft, and those of grids, which are possible where
#: nothing is read.
USUAL, OF_GRIDS = (50.0, 60.0, 400.0), (50.0, 60.0)
#: Lowest frequencies of the bands that are tried (Hz), the least ratio of a band's ends and the
#: fewest frequencies in it.
BANDS, WIDTH, FEWEST = (300.0, 450.0, 700.0, 1000.0, 1400.0, 2000.0, 2800.0, 4000.0, 5600.0), 2.0, 4
#: Hz that a sweep must reach.
REACH = 1000.0
#: Of S and N: what a law may miss beside the noise; probability below which it is not believed.
MODEL, BELIEVED = 3e-3, 1e-2
#: ms, of digital control.
DELAYS = (0.02, 0.04, 0.06, 0.09, 0.12, 0.16, 0.2, 0.25, 0.3, 0.4)
#: chi2 per number beyond which a start leads nowhere.
HOPELESS = 30.0
#: Least doubt of a reading, as a part of it.
LEAST = 1e-2
#: Doubts within which a reading is of a usual frequency, and beyond which it is not of the declared
#: one.
NEAR, BEYOND = 2.5, 5.0
#: Largest doubt of a reading that says anything, as a part of it.
VAGUE = 0.05

Residuals = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class FrequencyReading:
    """`hertz` : f0 as the high frequencies show it. `doubt` : one standard deviation, what the laws
    may miss included.
    `lowest` : Hz, from where on they hold.
    """

    hertz: float
    doubt: float
    lowest: float

    @property
    def sure(self) -> bool:
        """True when it says anything."""
        return 0 < self.doubt <= VAGUE * self.hertz

    def is_near(self, hertz: float) -> bool:
        """True when it is of this frequency."""
        return abs(self.hertz - hertz) < NEAR * self.doubt

    def is_beyond(self, hertz: float) -> bool:
        """True when it is not of this frequency."""
        return abs(self.hertz - hertz) > BEYOND * self.doubt


def frequency_reading(point: PointSweep, noise: PointNoise) -> FrequencyReading | None:
    """f0 at one operating point; None where its high frequencies follow no law of a filter.

    Each law is fitted to S and N in the widest band in which it holds: an L or an LCL filter beyond
    the reach of control, g = R + j X f (f^2 - a)/(f^2 - b), of which the surer counts, doubted by
    what the other contradicts it; else an L filter under digital control.
    """
    if point.excitation is not None or point.damping or point.frequency[-1] < REACH:
        return None
    high = _High.of(point, noise)
    if high is None:
        return None
    for laws in ((_inductor, _filter), (_controlled,)):
        readings = [found for law in laws if (found := _lowest_band(high, law)) is not None]
        if readings:
            surest = min(readings, key=lambda one: one.doubt)
            apart = max(abs(one.hertz - surest.hertz) - 2 * one.doubt for one in readings)
            return FrequencyReading(surest.hertz, max(surest.doubt, apart), surest.lowest)
    return None


def frequency_readings(
    sweep: Sweep, noise: Mapping[str, PointNoise] | None = None
) -> list[FrequencyReading | None]:
    """Those of all operating points. noise : result of noise.estimate, if already known."""
    noise = estimate(sweep) if noise is None else noise
    return [frequency_reading(point, noise[point.op.name]) for point in sweep.points]


def contradicting_readings(
    sweep: Sweep, noise: Mapping[str, PointNoise] | None = None
) -> list[FrequencyReading]:
    """The readings of all operating points where each is sure and beyond the declared f0; none as
    soon as one is not, so that most sweeps are read at one operating point.

    noise : result of noise.estimate, if already known.
    """
    readings = []
    for point in sweep.points:
        known = estimate_point(point) if noise is None else noise[point.op.name]
        reading = frequency_reading(point, known)
        if reading is None or not reading.sure or not reading.is_beyond(sweep.f0_hz):
            return []
        readings.append(reading)
    return readings


def possible_frequencies(
    readings: Sequence[FrequencyReading | None], declared: float
) -> tuple[float, ...]:
    """Values of f0 that may be meant in place of the declared one: what all operating points show,
    else those of grids but for what one contradicts that shows the declared one. A reading that
    shows neither is left out: decoupling is in it.
    """
    other = other_frequency(readings, declared)
    if other is not None:
        return (other[0],)
    as_declared = [one for one in readings if one is not None and one.is_near(declared)]
    possible = (one for one in OF_GRIDS if one != declared)
    return tuple(
        usual
        for usual in possible
        if all(abs(one.hertz - usual) < BEYOND * one.doubt for one in as_declared)
    )


def other_frequency(
    readings: Sequence[FrequencyReading | None], declared: float
) -> tuple[float, float] | None:
    """The usual f0 that every operating point shows in place of the declared one, and the mean of
    their readings; else None.
    """
    sure = [one for one in readings if one is not None and one.sure]
    if not sure or len(sure) < len(readings):
        return None
    weights = np.array([one.doubt**-2 for one in sure])
    mean = float(weights @ [one.hertz for one in sure] / weights.sum())
    usual = min(USUAL, key=lambda one: abs(one - mean))
    near = all(one.is_near(usual) for one in sure)
    beyond = all(one.is_beyond(declared) for one in sure)
    return (usual, mean) if near and beyond and usual != declared else None


@dataclass(frozen=True, eq=False)
class _High:
    """S and N (K,) from a frequency (Hz) on, and the standard deviation of their real and imaginary
    parts.
    """

    frequency: np.ndarray
    S: np.ndarray
    N: np.ndarray
    sigma_S: np.ndarray
    sigma_N: np.ndarray

    @classmethod
    def of(cls, point: PointSweep, noise: PointNoise) -> "_High | None":
        chosen = point.frequency >= BANDS[0]
        admittance = point.admittance[chosen]
        size = np.abs(np.linalg.det(admittance))
        if chosen.sum() < FEWEST or not (size > 0).all():
            return None
        z = np.linalg.inv(admittance)
        S = (z[:, 0, 0] + z[:, 1, 1]) / 2
        N = (z[:, 1, 0] - z[:, 0, 1]) / 2
        spread = np.zeros(z.shape) if noise.sigma is None else propagate(z, noise.sigma[chosen], z)
        sigma_S = np.hypot(np.hypot(spread[:, 0, 0], spread[:, 1, 1]) / 2, MODEL * np.abs(S))
        sigma_N = np.hypot(np.hypot(spread[:, 1, 0], spread[:, 0, 1]) / 2, MODEL * np.abs(N))
        if not (sigma_S > 0).all() or not (sigma_N > 0).all():
            return None
        return cls(point.frequency[chosen], S, N, sigma_S, sigma_N)

    def above(self, lowest: float) -> "_High":
        chosen = self.frequency >= lowest
        return _High(*(values[chosen] for values in vars(self).values()))

    @property
    def first_look(self) -> float:
        """f0 as the median quotient has it."""
        return float(np.median(self.frequency * np.imag(-self.N / self.S)))


def _lowest_band(high: _High, law: "_Law") -> FrequencyReading | None:
    """The reading of a law in the widest band in which it holds, as it does in all narrower
    ones.
    """
    widest = None
    for lowest in reversed(BANDS):
        band = high.above(lowest)
        if len(band.frequency) < FEWEST or band.frequency[-1] < WIDTH * band.frequency[0]:
            continue
        found = law(band)
        if found is None:
            break
        widest = found
    return widest


_Law = Callable[[_High], FrequencyReading | None]


def _inductor(high: _High) -> FrequencyReading | None:
    return _passive(high, [[]])


def _filter(high: _High) -> FrequencyReading | None:
    first = (high.frequency[0] / 1e3) ** 2
    return _passive(high, [[0.1 * first, 0.0], [0.6 * first, 0.1 * first]])


def _passive(high: _High, resonances: list[list[float]]) -> FrequencyReading | None:
    """S and N of g = R + j X f (f^2 - a)/(f^2 - b), f in kHz.

    resonances : (a, b) to begin at, or none.
    """
    f = high.frequency / 1e3
    resistance = float(np.median(np.real(high.S)))
    reactance = float(np.median(np.imag(high.S) / f))

    def impedance(at: np.ndarray, x: np.ndarray) -> np.ndarray:
        a, b = (x[3], x[4]) if len(x) > 3 else (0.0, 0.0)
        return x[1] + 1j * x[2] * at * (at**2 - a) / (at**2 - b)

    def residuals(x: np.ndarray) -> np.ndarray:
        positive, negative = impedance(f + x[0], x), impedance(f - x[0], x)
        left = (positive + negative) / 2 - high.S
        right = (positive - negative) / 2j - high.N
        return _parts(left / high.sigma_S, right / high.sigma_N)

    starts = [[high.first_look / 1e3, resistance, reactance, *pair] for pair in resonances]
    fit = _fitted(residuals, starts)
    return None if fit is None else _reading(1e3 * fit[0][0], 1e3 * fit[1], high)


def _controlled(high: _High) -> FrequencyReading | None:
    """S = (R + j X f + c d)/(1 - k d), N = X f0/(1 - k d), d = e^{-j 2 pi f T}, f in kHz, T in ms:
    an L filter, the current controller c and the feedforward k of a digital control.

    Both times 1 - k d are linear in all but T: that is how the start is found.
    """
    f = high.frequency / 1e3

    def residuals(x: np.ndarray) -> np.ndarray:
        f0, resistance, reactance, controller, feedforward, delay = x
        late = np.exp(-2j * np.pi * f * delay)
        left = (resistance + 1j * reactance * f + controller * late) / (
            1 - feedforward * late
        ) - high.S
        right = reactance * f0 / (1 - feedforward * late) - high.N
        return _parts(left / high.sigma_S, right / high.sigma_N)

    def started(delay: float) -> tuple[float, list[float]]:
        late, none = np.exp(-2j * np.pi * f * delay), np.zeros_like(f)
        of_S = (
            np.stack([none, none + 1, 1j * f, late, high.S * late], axis=1) / high.sigma_S[:, None]
        )
        of_N = np.stack([none + 1, none, none, none, high.N * late], axis=1) / high.sigma_N[:, None]
        matrix = _parts(of_S, of_N)
        wanted = _parts(high.S / high.sigma_S, high.N / high.sigma_N)
        x, *_ = np.linalg.lstsq(matrix, wanted, rcond=1e-9)
        left = float(np.sum((matrix @ x - wanted) ** 2))
        return left, [float(x[0] / x[2]), *map(float, x[1:]), delay]

    left, start = min(map(started, DELAYS))
    if not left < HOPELESS * 4 * len(f):
        return None
    fit = _fitted(residuals, [start])
    return None if fit is None else _reading(1e3 * fit[0][0], 1e3 * fit[1], high)


def _fitted(residuals: Residuals, starts: list[list[float]]) -> tuple[np.ndarray, float] | None:
    """The best end x and the standard deviation of x[0]; None where no start ends at what noise may
    leave.
    """
    best, left, doubt = None, np.inf, np.inf
    for start in starts:
        with np.errstate(all="ignore"):
            if not np.isfinite(residuals(np.array(start))).all():
                continue
            try:
                end = least_squares(
                    residuals,
                    start,
                    method="lm",
                    x_scale=np.maximum(np.abs(start), 1e-2),
                    max_nfev=80,
                )
            except (ValueError, np.linalg.LinAlgError):
                continue
        if np.isfinite(end.x).all() and 2 * end.cost < left:
            best, left = end, 2 * end.cost
            doubt = float(np.sqrt(np.linalg.pinv(end.jac.T @ end.jac)[0, 0]))
    if best is None:
        return None
    freedom = len(best.fun) - len(best.x)
    return (best.x, doubt) if freedom > 0 and chdtrc(freedom, left) > BELIEVED else None


def _reading(hertz: float, doubt: float, high: _High) -> FrequencyReading:
    return FrequencyReading(
        abs(hertz), float(np.hypot(doubt, LEAST * hertz)), float(high.frequency[0])
    )


def _parts(*values: np.ndarray) -> np.ndarray:
    return np.concatenate([part for one in values for part in (np.real(one), np.imag(one))])
