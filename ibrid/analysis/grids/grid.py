"""The grid behind the PCC: a series R and L of a short-circuit ratio, given values, or a measured
impedance.
"""

from dataclasses import dataclass, field, replace
from math import hypot, isclose, isfinite, sqrt

import numpy as np
from scipy.interpolate import PchipInterpolator

from ibrid.errors import IbridError
from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.ranges import require_in_range, written_number, written_whole

J = np.array([[0.0, -1.0], [1.0, 0.0]])
SCR_FORM = "short-circuit ratios are written 1.5:10, 1.5:10:20 for 20 of them, or 3 for one"
RL_FORM = (
    "a grid is written r=0.02,x=0.3 (per unit on the inverter's base), or is the file of a "
    "measured impedance"
)
#: Short-circuit ratios between both ends of a range when no number is given.
RATIOS = 12
#: Nominal frequencies that differ by less are the same.
SAME_HZ = 1e-3


@dataclass(frozen=True)
class SeriesRL:
    """v_PCC = v_Th + (r + x s/omega_0 + x J) i with the current i out of the inverter, per unit on
    its base.

    `r`, `x` : resistance and reactance at nominal frequency. `omega_0` : rad/s.
    """

    r: float
    x: float
    omega_0: float

    def __post_init__(self) -> None:
        if not (isfinite(self.r) and isfinite(self.x)) or self.r < 0 or self.x <= 0:
            raise IbridError(
                "the resistance of a grid must be zero or positive and its reactance positive, "
                f"found r = {self.r:g}, "
                f"x = {self.x:g}; {RL_FORM}"
            )
        require_in_range("grid_r", self.r, "the resistance r of a grid", IbridError)
        require_in_range("grid_x", self.x, "the reactance x of a grid", IbridError)

    @property
    def scr(self) -> float:
        """Short-circuit ratio 1 / |r + j x| at nominal voltage."""
        return 1.0 / hypot(self.r, self.x)

    def impedance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex: (r + j omega x / omega_0) I + x J."""
        s = 2j * np.pi * np.asarray(frequency, dtype=float)
        return (self.r + self.x * s / self.omega_0)[:, None, None] * np.eye(2) + self.x * J


@dataclass(frozen=True, eq=False)
class MeasuredGrid(Frozen):
    """A measured impedance, v_PCC = v_Th + Z i with the current i out of the inverter into the
    grid, per unit.

    `frequency` (K,) Hz, ascending. `values` (K, 2, 2) complex. `omega_0` : rad/s. `warnings` : what
    looks wrong, in sentences. `s_base_va`, `v_base_v` : base of the per-unit values, where known.
    Between its frequencies the entries are interpolated (monotone cubic, over the logarithm of the
    frequency). Beyond them nothing is known; there it goes on from its end points as a series R and
    L does, so that the Nyquist locus can be closed.
    """

    name: str
    frequency: np.ndarray
    values: np.ndarray
    omega_0: float
    warnings: tuple[str, ...] = field(default=())
    s_base_va: float | None = None
    v_base_v: float | None = None

    def on_base(self, s_base_va: float | None, v_base_v: float | None) -> "MeasuredGrid":
        """The same ohms, per unit on the base of an inverter; a warning says what is assumed where
        the bases differ.
        """
        pairs = zip((self.s_base_va, self.v_base_v), (s_base_va, v_base_v), strict=True)
        if all(
            own == other or (own and other and isclose(own, other, rel_tol=1e-6))
            for own, other in pairs
        ):
            return self
        silent, ratio = self.name if s_base_va and v_base_v else "the record", 1.0
        assumed = (
            f"{silent} does not tell both s_base_va and v_base_v, so that {self.name} is taken to "
            "be per unit on the inverter's "
            "base; add both lines to the sweep file"
        )
        if s_base_va and v_base_v and self.s_base_va and self.v_base_v:
            ratio = (self.v_base_v / v_base_v) ** 2 * s_base_va / self.s_base_va
            assumed = (
                f"{self.name} is on a base of {self.s_base_va:g} VA and {self.v_base_v:g} V, the "
                f"record of {s_base_va:g} VA and "
                f"{v_base_v:g} V: its ohms are taken as they are; refer them to the inverter's "
                "side of a transformer between"
            )
        return replace(self, values=ratio * self.values, warnings=(*self.warnings, assumed))

    def impedance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex."""
        frequency = np.asarray(frequency, dtype=float)
        inside = np.clip(frequency, self.frequency[0], self.frequency[-1])
        impedance: np.ndarray = self._interpolated(inside)
        for end, where in (
            (0, frequency < self.frequency[0]),
            (-1, frequency > self.frequency[-1]),
        ):
            line = self.continued(end)
            beyond, here = line.impedance(frequency[where]), line.impedance(self.frequency[[end]])
            impedance[where] = self.values[end] + beyond - here
        return impedance

    def continued(self, end: int) -> SeriesRL:
        """The series R and L that continues the first (0) or the last (-1) point: r and x of its
        mean diagonal.
        """
        mean = np.trace(self.values[end]) / 2
        x = float(mean.imag) * self.omega_0 / (2 * np.pi * float(self.frequency[end]))
        return SeriesRL(max(float(mean.real), 0.0), max(x, 1e-9), self.omega_0)

    def _interpolated(self, frequency: np.ndarray) -> np.ndarray:
        if len(self.frequency) == 1:
            return np.repeat(self.values, len(frequency), axis=0)
        known = np.log(self.frequency)
        at = np.clip(np.log(frequency), known[0], known[-1])
        parts = [
            PchipInterpolator(known, part, axis=0)(at)
            for part in (np.real(self.values), np.imag(self.values))
        ]
        return parts[0] + 1j * parts[1]


def of_ratio(scr: float, xr: float, omega_0: float) -> SeriesRL:
    """The grid of a short-circuit ratio at nominal voltage: |r + j x| = 1 / scr, x / r = xr
    (infinite: no resistance).
    """
    require_ratio(scr)
    if not xr > 0:
        raise IbridError(
            f"the ratio X/R of a grid must be positive, found {xr:g}; 10 is usual at high voltage"
        )
    if isfinite(xr):
        require_in_range("xr", xr, "the ratio X/R of a grid (--xr)", IbridError)
    r = 1.0 / (scr * sqrt(1.0 + xr**2))
    return SeriesRL(r, 1.0 / scr if not isfinite(xr) else xr * r, omega_0)


def require_ratio(scr: float) -> None:
    """Raise IbridError unless a short-circuit ratio is a positive number."""
    if not (isfinite(scr) and scr > 0):
        raise IbridError(
            f"a short-circuit ratio must be a positive number, found {scr:g}; below about 1 a grid "
            "cannot carry the rated "
            f"power, 2 is weak, 20 is strong; {SCR_FORM}"
        )
    require_in_range("scr", scr, "a short-circuit ratio", IbridError)


def ratios(text: str) -> np.ndarray:
    """Ascending short-circuit ratios from "A:B[:N]", logarithmically spaced, or from one number;
    IbridError otherwise.
    """
    parts = text.split(":", 2)
    try:
        ends = [written_number(one) for one in parts[:2]]
        count = written_whole(parts[2]) if len(parts) == 3 else RATIOS
    except ValueError:
        raise IbridError(f"{SCR_FORM}; found {text!r}") from None
    for one in ends:
        require_ratio(one)
    if len(ends) == 1:
        return np.array(ends)
    if ends[0] == ends[1]:
        raise IbridError(
            f"{SCR_FORM}, from a weaker to a stronger grid; found {text!r}, write {ends[0]:g} for "
            "one"
        )
    if ends[0] > ends[1]:
        raise IbridError(
            f"{SCR_FORM}, the weaker grid first; found {text!r}, write {ends[1]:g}:{ends[0]:g}"
        )
    if not 2 <= count <= 1000:
        raise IbridError(f"{SCR_FORM}, from 2 to 1000 of them; found {count}")
    return np.array([float(f"{one:.12g}") for one in np.geomspace(ends[0], ends[1], count)])


def series_rl(text: str, omega_0: float) -> SeriesRL:
    """The grid in "r=0.02,x=0.3"; IbridError when it is written otherwise."""
    values: dict[str, float] = {}
    for part in text.split(","):
        key, _, number = (piece.strip() for piece in part.partition("="))
        if key in values:
            raise IbridError(f"{RL_FORM}, each once; found {text!r}")
        try:
            values[key] = written_number(number)
        except ValueError:
            raise IbridError(f"{RL_FORM}; found {text!r}") from None
    if set(values) != {"r", "x"}:
        raise IbridError(f"{RL_FORM}, both r and x; found {text!r}")
    return SeriesRL(values["r"], values["x"], omega_0)


def measured_grid(sweep: Sweep, f0_hz: float) -> MeasuredGrid:
    """The impedance in a sweep file: its Z columns, or the inverse of its Y, current into the grid.

    Raises IbridError for several operating points, another nominal frequency or a singular
    admittance.
    """
    name = sweep.source or "the grid"
    if len(sweep.points) != 1:
        raise IbridError(
            f"{name}: a grid's impedance must be one sweep, found {len(sweep.points)} operating "
            "points "
            f"({'; '.join(sweep.names[:4])}); keep the rows of one"
        )
    if abs(sweep.f0_hz - f0_hz) > SAME_HZ * f0_hz:
        raise IbridError(
            f"{name}: the nominal frequency of the grid must be that of the record, found "
            f"{sweep.f0_hz:g} and {f0_hz:g} Hz; "
            "add a line '# f0_hz: ..' to the file if it is missing there"
        )
    (point,) = sweep.points
    try:
        impedance = np.linalg.inv(point.admittance)
    except np.linalg.LinAlgError:
        raise IbridError(
            f"{name}: the grid's admittance is singular at some frequency; give its impedance in Z "
            "columns"
        ) from None
    hermitian = np.linalg.eigvalsh((impedance + np.conj(np.swapaxes(impedance, 1, 2))) / 2)
    active = float((hermitian.sum(axis=1) < 0).mean())
    outwards = (
        f"{name} absorbs less than nothing at {100 * active:.0f} % of its frequencies, as if the "
        "current were counted out of "
        "the grid; if so add the line '# current: in' to the file"
    )
    warnings = (outwards,) if active > 0.5 else ()
    return MeasuredGrid(
        name,
        np.array(point.frequency),
        impedance,
        sweep.omega_0,
        warnings,
        sweep.s_base_va,
        sweep.v_base_v,
    )
