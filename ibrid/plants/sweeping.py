"""Sweeping a reference inverter: by linearisation or by injection, at given operating points and
frequencies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, isfinite
from typing import Literal

import casadi as ca
import numpy as np

from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.errors import IbridError, OperatingPointError, SweepError, near
from ibrid.frozen import Frozen
from ibrid.interrupts import hearing_interrupts, heed_interrupt
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.operating_points import operating_point as operating_point
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.published import PLANTS
from ibrid.plants.reference import ReferenceInverter
from ibrid.ranges import require_in_range, written_number, written_whole


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class Linearisation(Frozen):
    """dx/dt = A x + B v_DQ, i_DQ = C x + D v_DQ around an equilibrium; current out of the inverter,
    per unit.

    states : names of x; A (n, n), B (n, 2), C (2, n), D (2, 2); x_eq (n,) the equilibrium itself.
    """

    states: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x_eq: np.ndarray

    @property
    def poles(self) -> np.ndarray:
        """(n,) rad/s."""
        return np.linalg.eigvals(self.A)

    @property
    def is_stable(self) -> bool:
        """Every pole has a negative real part."""
        return bool((np.real(self.poles) < 0).all())

    def admittance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2) complex: Y = C (j omega I - A)^-1 B + D at `frequency`, (K,) Hz."""
        omega = 2 * np.pi * np.asarray(frequency, dtype=float)
        resolvent = 1j * omega[:, None, None] * np.eye(len(self.A)) - self.A
        return (
            self.C
            @ np.linalg.solve(resolvent, np.broadcast_to(self.B, (len(omega), *self.B.shape)))
            + self.D
        )


@takes_kinds
def state_space(plant: ReferenceInverter, op: OperatingPoint) -> Linearisation:
    """Linearise at an operating point; OperatingPointError when it does not exist."""
    rest = plant.at_rest(op)
    A, B, C, D = (np.asarray(m) for m in plant.dynamics.jacobian(rest.x, [op.v, 0.0], rest.r))
    return Linearisation(plant.dynamics.states, A, B, C, D, rest.x)


@takes_kinds
def is_stable(plant: ReferenceInverter, op: OperatingPoint, *, margin: float = 0.0) -> bool:
    """Whether, on a stiff grid, every pole lies left of -margin rad/s; no operating point, no
    stability.
    """
    try:
        return bool((np.real(state_space(plant, op).poles) < -margin).all())
    except OperatingPointError:
        return False


AMPLITUDE = 2e-4
AGREEMENT = 1e-4
SHORTEST_RECORD = 0.02
FEWEST_PERIODS = 4
LONGEST_SIMULATION = 60.0


def injected_admittance(
    plant: ReferenceInverter,
    op: OperatingPoint,
    frequency: np.ndarray,
    *,
    amplitude: float = AMPLITUDE,
) -> np.ndarray:
    """(K, 2, 2) complex: measured Y at `frequency`, (K,) Hz, one simulation per frequency and axis.

    Law: v_DQ = [v, 0] + a sin(omega t) on one axis, from the equilibrium; in each record of whole
    periods the phasor is I = 2 / T integral (1 - cos(2 pi t / T)) i(t) exp(-j omega t) dt, whose
    Hann window suppresses what still decays at other frequencies; Y = I / (-j a).

    amplitude : a, per unit; distortion grows with its square.
    Raises SweepError when the response is not steady after LONGEST_SIMULATION seconds.
    """
    record = _record(plant, op)
    columns = [
        [_column(record, hz, axis, amplitude, op) for axis in (0, 1)]
        for hz in np.asarray(frequency)
    ]
    return np.moveaxis(np.array(columns), 1, 2)


def _column(
    record: ca.Function, hz: float, axis: int, amplitude: float, op: OperatingPoint
) -> np.ndarray:
    """(2,) response of i_DQ to a sinusoid on one axis, relative to it."""
    direction = np.eye(2)[axis] * amplitude
    periods = max(FEWEST_PERIODS, ceil(SHORTEST_RECORD * hz))
    state, time, before = 0.0, 0.0, None
    while time < LONGEST_SIMULATION:
        duration = periods / hz
        try:
            answer = record(x0=state, p=ca.vertcat(duration, 2 * np.pi * hz, *direction))
        except RuntimeError:  # the solver needs too many steps
            heed_interrupt()
            raise SweepError(
                f"{duration:g} s of simulation at {hz:g} Hz and operating point {op.name} must be "
                "possible; the solver gave up, "
                "sweep by linearisation or at higher frequencies."
            ) from None
        parts = np.asarray(answer["qf"]).ravel()
        phasor = 2 * (parts[:2] + 1j * parts[2:]) / (-1j * amplitude)
        if before is not None and np.linalg.norm(phasor - before) <= AGREEMENT * np.linalg.norm(
            phasor
        ):
            return phasor
        state, time, before, periods = answer["xf"], time + duration, phasor, 2 * periods
    raise SweepError(
        f"the response at {hz:g} Hz and operating point {op.name} must be steady within "
        f"{LONGEST_SIMULATION:g} s of "
        "simulation; it was not, sweep by linearisation or choose a better damped operating point."
    )


def _record(plant: ReferenceInverter, op: OperatingPoint) -> ca.Function:
    """Integrator over one record in normalised time, of the deviation from the equilibrium.

    Small deviations keep their own digits; the quadratures are the windowed real and imaginary
    parts of i_DQ.
    """
    dynamics, rest = plant.dynamics, plant.at_rest(op)
    x_eq = rest.x
    z, tau = ca.SX.sym("z", len(x_eq)), ca.SX.sym("tau")
    duration, omega, injected = ca.SX.sym("duration"), ca.SX.sym("omega"), ca.SX.sym("injected", 2)
    angle = omega * duration * tau
    v_DQ = ca.vertcat(op.v, 0) + injected * ca.sin(angle)
    i_DQ = dynamics.g(x_eq + z, v_DQ) - dynamics.g(x_eq, [op.v, 0.0])
    window = 1 - ca.cos(2 * ca.pi * tau)
    problem = {
        "x": z,
        "t": tau,
        "p": ca.vertcat(duration, omega, injected),
        "ode": duration * dynamics.f(x_eq + z, v_DQ, rest.r),
        "quad": ca.vertcat(window * i_DQ * ca.cos(angle), -window * i_DQ * ca.sin(angle)),
    }
    # Adams formulas: the motion is oscillatory at the injected frequency, and of a higher order
    # than BDF there
    options = {
        "linear_multistep_method": "adams",
        "abstol": 1e-13,
        "reltol": 1e-9,
        "quad_err_con": True,
        "max_num_steps": 10_000_000,
    }
    return ca.integrator("record", "cvodes", problem, 0.0, 1.0, options)


Method = Literal["linear", "time"]


@takes_kinds
def plant_named(name: str) -> ReferenceInverter:
    """The reference inverter called `name`; IbridError with near names otherwise."""
    if name not in PLANTS:
        raise IbridError(f"there is no reference inverter called {name}; {near(name, PLANTS)}")
    return PLANTS[name]


@takes_kinds
@hearing_interrupts()
def sweep(
    plant: ReferenceInverter | str,
    operating_points: Sequence[OperatingPoint | str] | None,
    frequency: np.ndarray,
    *,
    method: Method = "linear",
    noise_db: float | None = None,
    repeats: int = 1,
    seed: int = 0,
    overrides: Mapping[str, float | str] = {},
) -> Sweep:
    """The admittance sweep that a measurement of this inverter would give.

    plant : a reference inverter or its name.
    operating_points : or "p=0.5,q=0[,v=1.02]", per unit; None: the plant's own.
    frequency : (K,) Hz, ascending.
    method : "linear": Y = C (j omega I - A)^-1 B + D; "time": sinusoids injected into the nonlinear
    simulation.
    noise_db, repeats, seed : noise of each of `repeats` runs, in dB below the norm of Y; None:
    clean.
    overrides : other parameter values, named as in the diagram ("plant.L_F") or as fields of its
    parameters ("L_F").

    Raises IbridError for an unknown name, OperatingPointError where the operating point does not
    exist or is unstable.
    """
    plant = (plant_named(plant) if isinstance(plant, str) else plant).with_overrides(overrides)
    if method not in ("linear", "time"):
        raise SweepError(f"method must be linear or time; found {method}.")
    if noise_db is None and repeats != 1:
        raise SweepError(
            f"repeats of a clean sweep are all alike; found repeats = {repeats} without noise_db, "
            "give noise_db too."
        )
    frequency = frequencies_of(frequency)
    said = plant.operating_points if operating_points is None else operating_points
    points = [operating_point(one) if isinstance(one, str) else one for one in said]
    clean = Sweep(
        points=tuple(
            PointSweep(op, frequency, _admittance(plant, op, frequency, method)) for op in points
        ),
        f0_hz=plant.f0_hz,
        power_node=plant.power_node,
        s_base_va=plant.s_base_va,
        v_base_v=plant.v_base_v,
        source=f"reference inverter {plant.name}, {method} sweep",
    )
    if noise_db is None:
        return clean
    noisy = add_noise(clean, noise_db, rng=np.random.default_rng(seed), repeats=repeats)
    return replace(
        noisy, notes=(*noisy.notes, f"noise {noise_db:g} dB, {repeats} runs, seed {seed}")
    )


def _admittance(
    plant: ReferenceInverter, op: OperatingPoint, frequency: np.ndarray, method: Method
) -> np.ndarray:
    linear = state_space(plant, op)
    if not linear.is_stable:
        worst = max(linear.poles, key=lambda pole: pole.real)
        raise OperatingPointError(
            f"reference inverter {plant.name} must be stable to be swept; at {op.name} it has a "
            "pole at "
            f"{worst.real:.3g} + {abs(worst.imag):.3g}j rad/s, try another operating point or "
            "other values."
        )
    if method == "time":
        return injected_admittance(plant, op, frequency)
    return linear.admittance(frequency)


@takes_kinds
def frequency_grid(text: str) -> np.ndarray:
    """(N,) Hz from "A:B:N": N logarithmically spaced frequencies from A to B, both included.

    Raises SweepError when the text has another form or 0 < A < B, N >= 2 does not hold (A = B with
    N = 1 is allowed).
    """
    form = "frequencies are written A:B:N, for instance 5:5000:16 for 16 points from 5 to 5000 Hz"
    parts = text.split(":")
    try:
        low, high = written_number(parts[0]), written_number(parts[1])
        count = written_whole(parts[2])
    except (ValueError, IndexError):
        raise SweepError(f"{form}; found {text!r}.") from None
    single = count == 1 and low == high
    if len(parts) != 3:
        raise SweepError(f"{form}, three numbers; found {text!r}.")
    if not (isfinite(low) and isfinite(high) and low > 0):
        raise SweepError(f"{form}, both positive; found {text!r}.")
    if not single and (low >= high or not 2 <= count <= 100_000):
        raise SweepError(f"{form}, with A below B and N from 2 to 100000; found {text!r}.")
    for end in (low, high):
        require_in_range("freq_hz", end, f"{form}; each of them")
    # twelve digits: 50, not 49.99999999999999, and the same on every machine
    return np.array([float(f"{hz:.12g}") for hz in np.geomspace(low, high, count)])
