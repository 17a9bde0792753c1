"""What was seen at the terminals: per operating point, frequencies, the 2x2 dq admittance and how
uncertain it is.

Everything is per unit on the inverter's base, current out of the inverter, q axis leading d
(readers convert).
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, pi
from numbers import Complex
from os import PathLike
from typing import Any, Literal, get_args

import numpy as np

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import OperatingPointError, SweepError, near
from ibrid.foreign_text import show_controls
from ibrid.frozen import Frozen, sealed
from ibrid.measurement.sweeps.masked import require_unmasked
from ibrid.ranges import require_in_range
from ibrid.showing import brief, made_above, shown
from ibrid.writing import require_text

PowerNode = Literal["capacitor", "pcc"]
#: Entries of a 2x2 dq admittance -> row and column, in the order of files and tables.
ENTRIES = {"dd": (0, 0), "dq": (0, 1), "qd": (1, 0), "qq": (1, 1)}

#: From d and q to complex phasors, d + jq and d - jq.
PN = np.array([[1, 1j], [1, -1j]])
#: How a band of frequencies is written: "10-500Hz", "1-2kHz", "500Hz-2kHz".
_NUMBER = r"\d+(?:\.\d*)?"
BAND = re.compile(
    rf"(?P<low>{_NUMBER})(?P<low_unit>k?Hz)?-(?P<high>{_NUMBER})(?P<unit>k?Hz)", re.IGNORECASE
)
#: Relative distance of two frequencies, above what rounding leaves.
APART = 1e-9


@methods_take_kinds
@dataclass(frozen=True)
class OperatingPoint:
    """Steady state at which a sweep was taken: what the inverter delivers, per unit.

    p : active power, positive when exporting.
    q : reactive power, q = e' J i with q leading, positive when the inverter delivers it.
    v : magnitude of the PCC voltage.

    Raises SweepError when a number is not finite or v is not positive.
    """

    name: str
    p: float
    q: float
    v: float = 1.0

    def __post_init__(self) -> None:
        require_kinds(self)
        if (
            not self.name
            or self.name != self.name.strip()
            or not self.name.isprintable()
            or self.name[0] == "#"
        ):
            raise SweepError(
                "the name of an operating point must be printable text without spaces around it or "
                "# in front; "
                f"found {self.name[:60]!r}."
            )
        for symbol in ("p", "q", "v"):
            value = getattr(self, symbol)
            if not isfinite(value):
                raise SweepError(
                    f"{symbol} of operating point {self.name} must be a finite number; found "
                    f"{value}."
                )
        if self.v <= 0:
            raise SweepError(
                f"v of operating point {self.name} must be positive; found {self.v:g}."
            )
        for symbol in ("p", "q", "v"):
            require_in_range(
                symbol, getattr(self, symbol), f"{symbol} of operating point {self.name}"
            )

    @property
    def pqv(self) -> tuple[float, float, float]:
        """The numbers without the name."""
        return self.p, self.q, self.v


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class PointSweep(Frozen):
    """The measurement at one operating point. Arrays are copied and read-only.

    op : the steady state.
    frequency : (K,) Hz, ascending, positive, unique.
    admittance : (K, 2, 2) complex, per unit, di = Y dv with the current out of the inverter; [[dd,
    dq], [qd, qq]].
        The mean over the repeats where there are repeats.
    sigma : (K, 2, 2) positive, standard deviation of each real and each imaginary part of
    `admittance`; None: unknown.
    repeats : (R, K, 2, 2) complex, the single runs; None: one run, or only their mean is known.
    amplitude : (K,) injected amplitude of the voltage, per unit; None: not recorded.
    larger : the same point at larger amplitudes, each larger at every frequency than the one
    before.
    excitation, damping : of a record that stands for a sweep (`recordings.transformed`);
    `admittance` is then what the
        device makes of the excitation (K, 2, 2), at s = damping + j omega, damping in 1/s. None: of
        either axis alone.
    predicted : by a model, which answers nothing without current and with unit feedforward.

    Raises SweepError when shapes disagree, a number is not finite, or a measured admittance is zero
    throughout.
    """

    op: OperatingPoint
    frequency: np.ndarray
    admittance: np.ndarray
    sigma: np.ndarray | None = None
    repeats: np.ndarray | None = None
    amplitude: np.ndarray | None = None
    larger: tuple["PointSweep", ...] = ()
    excitation: np.ndarray | None = None
    damping: float = 0.0
    predicted: bool = False

    def __post_init__(self) -> None:
        require_kinds(self)
        object.__setattr__(self, "larger", tuple(self.larger))
        for name in ("frequency", "admittance", "sigma", "repeats", "amplitude", "excitation"):
            require_unmasked(f"{name} of operating point {self.op.name}", getattr(self, name))
        frequency = _frozen(self.frequency, float)
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "admittance", _frozen(self.admittance, complex))
        for name, kind in (
            ("sigma", float),
            ("repeats", complex),
            ("amplitude", float),
            ("excitation", complex),
        ):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _frozen(getattr(self, name), kind))
        self._check_frequency()
        count = len(frequency)
        self._check("admittance", (count, 2, 2))
        self._check("sigma", (count, 2, 2))
        self._check("amplitude", (count,))
        self._check("excitation", (count, 2, 2))
        if any(one.op != self.op or one.amplitude is None or one.larger for one in self.larger):
            raise SweepError(
                f"larger amplitudes of operating point {self.op.name} must be at that operating "
                "point, each with its "
                "amplitude; join the sweeps with ibrid.measurement.sweeps.amplitudes.joined."
            )
        if self.repeats is not None:
            self._check("repeats", (len(self.repeats) if self.repeats.ndim else 0, count, 2, 2))
        if self.sigma is not None and not (self.sigma > 0).all():
            raise SweepError(
                f"sigma of operating point {self.op.name} must be positive; found "
                f"{self.sigma.min():g}, "
                "leave sigma out when the noise is unknown."
            )
        if not (self.predicted or self.admittance.any()):
            raise SweepError(
                f"the admittance of operating point {self.op.name} must not be zero throughout; "
                "check that the columns hold the measured values."
            )

    def __repr__(self) -> str:
        span = (
            f", {len(self.frequency)} frequencies, {self.frequency[0]:g} to {self.frequency[-1]:g} "
            "Hz>"
        )
        return brief(f"<PointSweep: {self.op.name}", span)

    @property
    def omega(self) -> np.ndarray:
        """(K,) rad/s."""
        return 2 * pi * self.frequency

    @property
    def line(self) -> np.ndarray:
        """(K,) where the answer was measured, s in rad/s."""
        return self.damping + 1j * self.omega

    @property
    def Y(self) -> np.ndarray:
        """(K, 2, 2) the admittance, per unit."""
        return self.admittance

    @property
    def Z(self) -> np.ndarray:
        """(K, 2, 2) the impedance, per unit; SweepError where the admittance is singular."""
        try:
            return np.linalg.inv(self.admittance)
        except np.linalg.LinAlgError:
            raise SweepError(
                f"the admittance of operating point {self.op.name} is singular at a frequency and "
                "has no impedance there; leave that frequency out with at(...)."
            ) from None

    @property
    def db(self) -> np.ndarray:
        """(K, 2, 2) 20 log10 |Y|; minus infinity of zero."""
        with np.errstate(divide="ignore"):
            return 20 * np.log10(np.abs(self.admittance))

    @property
    def deg(self) -> np.ndarray:
        """(K, 2, 2) phase in degrees, unwrapped over frequency."""
        return np.degrees(np.unwrap(np.angle(self.admittance), axis=0))

    @property
    def pn(self) -> np.ndarray:
        """(K, 2, 2) the admittance of complex phasors, A Y A^-1 with A = [[1, j], [1, -j]]:
        positive sequence at f + f0 first, then the conjugate of the negative one at f - f0.
        """
        return PN @ self.admittance @ np.linalg.inv(PN)

    def at(self, chosen: np.ndarray) -> "PointSweep":
        """The measurement at some of its frequencies, and the larger amplitudes at those of them
        that they have.

        chosen : (K,) bool, or ascending places.
        """
        names = ("frequency", "admittance", "sigma", "amplitude", "excitation")
        own = {name: value[chosen] for name in names if (value := getattr(self, name)) is not None}
        larger = [(one, np.isin(one.frequency, own["frequency"])) for one in self.larger]
        return replace(
            self,
            **own,
            repeats=None if self.repeats is None else self.repeats[:, chosen],
            larger=tuple(one.at(kept) for one, kept in larger if kept.any()),
        )

    def _check_frequency(self) -> None:
        frequency = self.frequency
        if frequency.ndim != 1 or not len(frequency):
            raise SweepError(
                f"operating point {self.op.name} must have at least one frequency; found shape "
                f"{frequency.shape}."
            )
        if not np.isfinite(frequency).all() or frequency[0] <= 0 or (np.diff(frequency) <= 0).any():
            raise SweepError(
                f"the frequencies of operating point {self.op.name} must be finite, positive, "
                "ascending and unique; "
                "sort them and keep each one once."
            )
        for end in (frequency[0], frequency[-1]):
            require_in_range(
                "freq_hz", float(end), f"the frequencies of operating point {self.op.name}"
            )
        if (close := np.flatnonzero(np.diff(frequency) <= APART * frequency[1:])).size:
            low, high = frequency[close[0] : close[0] + 2].tolist()
            raise SweepError(
                f"the frequencies of operating point {self.op.name} must differ by more than "
                f"{APART:g} of themselves; found "
                f"{low!r} and {high!r} Hz, keep one of them or write a column repeat."
            )

    def _check(self, name: str, shape: tuple[int, ...]) -> None:
        value = getattr(self, name)
        if value is None:
            return
        if value.shape != shape:
            raise SweepError(
                f"{name} of operating point {self.op.name} must have shape {shape}; found "
                f"{value.shape}."
            )
        if not np.isfinite(value).all():
            raise SweepError(
                f"{name} of operating point {self.op.name} must be finite; found NaN or infinity, "
                "remove that frequency."
            )


def require_header(data: Any, what: str, numbers: Sequence[str]) -> None:
    """Raise SweepError unless `data.names` differ, the numbers are positive or None, and the power
    node is known.
    """
    twice = sorted(name for name, count in Counter(data.names).items() if count > 1)
    if twice:
        raise SweepError(f"{what} must have different names; {twice[0]} is there twice.")
    for name in numbers:
        value = getattr(data, name)
        if value is not None and not (isfinite(value) and value > 0):
            raise SweepError(f"{name} must be a positive number; found {value}.")
    if data.power_node not in get_args(PowerNode):
        raise SweepError(f"power_node must be capacitor or pcc; found {data.power_node}.")


#: Largest admittance of a sweep, per unit, and the inverse of the least that its largest may be:
#: beyond, squares are infinite or zero.
LARGEST = 1e40
#: Where sweeps are added, multiplied and interpolated.
_ARITHMETIC = "ibrid.measurement.sweeps.arithmetic"
#: Name of an operating point -> numbers at its frequencies.
ByPoint = dict[str, np.ndarray]


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Sweep(Frozen):
    """The measured operating points of one inverter.

    points : one PointSweep each, with different names; frequency grids may differ.
    f0_hz : nominal frequency, Hz.
    power_node : where p and q are measured, "capacitor" (of the LCL filter) or "pcc".
    s_base_va, v_base_v : per-unit base, if known; Z_base = v_base_v^2 / s_base_va.
    notes : comments of the file.
    source : path or description.
    sampling_hz : sampling rate of the controller, if known.

    Raises SweepError when there is no point, two points share a name or a number is out of range.
    """

    points: tuple[PointSweep, ...]
    f0_hz: float = 60.0
    power_node: PowerNode = "capacitor"
    s_base_va: float | None = None
    v_base_v: float | None = None
    notes: tuple[str, ...] = ()
    source: str = ""
    sampling_hz: float | None = None

    def __post_init__(self) -> None:
        require_kinds(self)
        object.__setattr__(self, "points", tuple(self.points))
        object.__setattr__(self, "notes", tuple(self.notes))
        object.__setattr__(self, "source", show_controls(self.source))
        if not self.points:
            raise SweepError("a sweep must have at least one operating point; found none.")
        require_header(self, "operating points", ("f0_hz", "s_base_va", "v_base_v", "sampling_hz"))

    @property
    def omega_0(self) -> float:
        """Nominal angular frequency, rad/s."""
        return 2 * pi * self.f0_hz

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the operating points."""
        return tuple(point.op.name for point in self.points)

    def point(self, name: str) -> PointSweep:
        """The measurement at operating point `name`; OperatingPointError, with the near names, if
        there is none.
        """
        for point in self.points:
            if point.op.name == name:
                return point
        raise OperatingPointError(
            f"operating point {name} is not in the sweep; {near(name, self.names)}"
        )

    def only(self, names: str | Iterable[str]) -> "Sweep":
        """The sweep with these operating points alone, in the given order."""
        return replace(self, points=tuple(self.point(name) for name in _listed(names)))

    def without(self, names: str | Iterable[str]) -> "Sweep":
        """The sweep with these operating points left out, as for a held-out test."""
        left_out = {self.point(name).op.name for name in _listed(names)}
        points = tuple(point for point in self.points if point.op.name not in left_out)
        if not points:
            raise OperatingPointError(
                "at least one operating point must remain; leaving out "
                f"{', '.join(sorted(left_out))} removes all."
            )
        return replace(self, points=points)

    def __getitem__(self, name: str) -> Any:
        """The measurement at the operating point of that name; or, of "10-500Hz" or "500Hz-2kHz",
        the sweep with the frequencies of that band.
        """
        band = BAND.fullmatch(name.replace(" ", ""))
        if name in self.names or band is None:
            return self.point(name)
        factors = {"hz": 1.0, "khz": 1000.0}
        low = float(band["low"]) * factors[(band["low_unit"] or band["unit"]).lower()]
        return self.between(low, float(band["high"]) * factors[band["unit"].lower()])

    def between(self, low: float, high: float) -> "Sweep":
        """The sweep at its frequencies from `low` to `high`, Hz, both included.

        Raises SweepError where an operating point has none there.
        """
        parts = []
        for point in self.points:
            within = (point.frequency >= low) & (point.frequency <= high)
            if not within.any():
                raise SweepError(
                    f"no frequency of {point.op.name} lies from {low:g} to {high:g} Hz; it has "
                    f"{point.frequency[0]:g} to {point.frequency[-1]:g} Hz."
                )
            parts.append(point.at(within))
        return replace(self, points=tuple(parts))

    def resample(self, frequencies: Sequence[float] | np.ndarray) -> "Sweep":
        """The sweep at other frequencies, Hz, between its own ones; SweepError beyond them."""
        return made_above(self, _ARITHMETIC, "resampled", frequencies)

    def __add__(self, other: Any) -> Any:
        """The sum of two sweeps of the same operating points and frequencies."""
        if not isinstance(other, Sweep):
            return NotImplemented
        return made_above(self, _ARITHMETIC, "added", other)

    def __sub__(self, other: Any) -> Any:
        """Their difference."""
        return self + -1.0 * other if isinstance(other, Sweep) else NotImplemented

    def __mul__(self, number: Any) -> Any:
        """Every admittance times a number."""
        if not isinstance(number, Complex):
            return NotImplemented
        return made_above(self, _ARITHMETIC, "multiplied", number)

    __rmul__ = __mul__

    def __truediv__(self, number: Any) -> Any:
        """Every admittance over a number."""
        if not isinstance(number, Complex):
            return NotImplemented
        return made_above(self, _ARITHMETIC, "divided", number)

    def __neg__(self) -> "Sweep":
        """Every admittance with the other sign."""
        return -1.0 * self

    @property
    def Y(self) -> ByPoint:
        """Admittances by operating point, (K, 2, 2), per unit."""
        return {point.op.name: point.Y for point in self.points}

    @property
    def Z(self) -> ByPoint:
        """Impedances by operating point, (K, 2, 2), per unit."""
        return {point.op.name: point.Z for point in self.points}

    @property
    def db(self) -> ByPoint:
        """Magnitudes in dB by operating point, (K, 2, 2)."""
        return {point.op.name: point.db for point in self.points}

    @property
    def deg(self) -> ByPoint:
        """Unwrapped phases in degrees by operating point, (K, 2, 2)."""
        return {point.op.name: point.deg for point in self.points}

    @property
    def pn(self) -> ByPoint:
        """Matrices of positive and negative sequence by operating point, (K, 2, 2)."""
        return {point.op.name: point.pn for point in self.points}

    def __repr__(self) -> str:
        lows, highs = zip(
            *((point.frequency[0], point.frequency[-1]) for point in self.points), strict=True
        )
        counts = sorted({len(point.frequency) for point in self.points})
        span = (
            f"{counts[0]}{'' if len(counts) == 1 else f' to {counts[-1]}'} frequencies, "
            f"{min(lows):g} to {max(highs):g} Hz"
        )
        return brief(
            f"<Sweep: {len(self.points)} operating points ({'; '.join(self.names)})", f", {span}>"
        )

    def plot(self, ax: Any = None, entry: str = "dd") -> Any:
        """A matplotlib figure of the four admittances; with ax=(magnitude, phase) of one entry, on
        those.
        """
        return shown(self, "plotting", "sweep_plot", ax, entry)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the sweep file, text in columns, that `read_sweep` takes back, replacing it
        atomically.
        """
        require_text(path, "a sweep")
        made_above(self, "ibrid.measurement.formats.csv_file", "write_sweep", path)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with the columns of a sweep file, per unit, current out, q leading;
        `read_sweep` takes it back.

        Base, frequency and power node are in its `attrs`. Raises SweepError without pandas.
        """
        return made_above(self, "ibrid.measurement.dataframe", "dataframe")

    def _repr_html_(self) -> str:
        """Operating points and the four admittances, for notebooks."""
        return shown(self, "pages.notebook", "sweep_html")


def measured_numbers(points: Iterable[PointSweep]) -> int:
    """Real numbers in the data of some operating points: the real and imaginary parts of four
    entries at each frequency; of one column where a record stands for a sweep.
    """
    return sum((8 if point.excitation is None else 4) * len(point.frequency) for point in points)


def _listed(names: Iterable[str]) -> list[str]:
    """A single name means that name, and not its letters."""
    return list(names) if isinstance(names, Iterable) and not isinstance(names, str) else [names]


def _frozen(value: np.ndarray, kind: type) -> np.ndarray:
    return sealed(np.asarray(value, dtype=kind))
