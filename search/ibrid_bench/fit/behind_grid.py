"""A nonlinear reference inverter behind a series R and L: does a small step of the source die out
or grow?

An independent check of stability in a grid: the nonlinear equations are integrated by SUNDIALS
CVODES, and neither poles nor an admittance are used.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.reference import ReferenceInverter

#: Relative step of the source's voltage.
STEP = 1e-7
#: Windows into which the time after the step is divided; the deviation in each is one number.
WINDOWS = 12
#: Samples in each window.
SAMPLES = 400
#: Deviation (per unit, rad) from which the motion has left the neighbourhood of the steady state:
#: ten thousand times the step.
LARGE = 1e-3


@dataclass(frozen=True, eq=False)
class StepResponse:
    """What follows a small step of the source's voltage.

    `time` (N,) s after the step. `deviation` (N, n) of the states from the equilibrium that they
    had. `growth` : rate in 1/s of the deviation's change from window to window at the end, positive
    where it grows.
    """

    time: np.ndarray
    deviation: np.ndarray
    growth: float

    @property
    def stable(self) -> bool:
        """The motion dies out."""
        return self.growth < 0


def step_behind_grid(
    plant: ReferenceInverter,
    op: OperatingPoint,
    r: float,
    x: float,
    *,
    duration: float = 4.0,
    step: float = STEP,
) -> StepResponse:
    """Simulate a step of the source behind r + j x from the steady state in which v, p, q at the
    inverter are those of `op`.

    Laws: dx/dt = f(x, v), i = g(x), v = v_Th + (r + x J) i + x/omega_0 di/dt in the DQ frame; f is
    affine in v, so v - x/omega_0 dg/dx f(x, v) = v_Th + (r + x J) i has one solution.

    r, x : per unit on the inverter's base. duration : s. step : relative change of |v_Th|.
    Raises IbridError when r is negative or x is not positive, or the simulation fails;
    OperatingPointError without a steady state.
    """
    if r < 0 or not x > 0:
        raise IbridError(f"the grid must have r >= 0 and x > 0; found r = {r:g}, x = {x:g}.")
    x_eq, rate, source = _motion(plant, op, r, x)
    window = duration / WINDOWS
    grid = np.linspace(0.0, window, SAMPLES + 1)
    z = ca.SX.sym("z", len(x_eq))
    problem = {"x": z, "ode": rate(z, source * (1.0 + step))}
    options = {
        "linear_multistep_method": "adams",
        "abstol": 1e-7 * step,
        "reltol": 1e-10,
        "max_num_steps": 10_000_000,
    }
    run = ca.integrator("step", "cvodes", problem, 0.0, grid[1:].tolist(), options)
    state, pieces = np.zeros(len(x_eq)), [np.zeros((1, len(x_eq)))]
    for _ in range(WINDOWS):
        try:
            answer = np.asarray(run(x0=state)["xf"]).T
        except RuntimeError as error:
            raise IbridError(
                f"the simulation at {op.name} behind r = {r:g}, x = {x:g} failed: {error}"
            ) from None
        pieces.append(answer)
        state = answer[-1]
        if np.abs(state).max() > LARGE:
            break
    deviation = np.concatenate(pieces)
    time = np.concatenate([[0.0], *(k * window + grid[1:] for k in range(len(pieces) - 1))])
    return StepResponse(time, deviation, _growth(time, pieces[1:], window))


def critical_ratio(
    plant: ReferenceInverter,
    op: OperatingPoint,
    low: float,
    high: float,
    *,
    xr: float,
    width: float = 0.01,
    **options: float,
) -> float:
    """The short-circuit ratio between `low` and `high` at which a small step begins to grow, by
    bisection to `width`.

    xr : X/R of the grid. options : of `step_behind_grid`. Raises IbridError when both ends are
    stable, or neither is.
    """

    def stable(scr: float) -> bool:
        r = 1.0 / (scr * np.hypot(1.0, xr))
        return step_behind_grid(plant, op, r, xr * r, **options).stable

    at_low = stable(low)
    if at_low == stable(high):
        raise IbridError(
            f"stability must differ between SCR {low:g} and {high:g}; found both "
            f"{'un' * (not at_low)}stable."
        )
    while high > low * (1 + width):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle) == at_low else (low, middle)
    return float(np.sqrt(low * high))


def _motion(
    plant: ReferenceInverter, op: OperatingPoint, r: float, x: float
) -> tuple[np.ndarray, ca.Function, np.ndarray]:
    """Steady state (n,), the rate of the deviation z from it as a function of (z, v_Th), and the
    v_Th that keeps it.
    """
    dynamics, rest = plant.dynamics, plant.at_rest(op)
    x_eq = rest.x
    z, v_th = ca.SX.sym("z", len(x_eq)), ca.SX.sym("v_th", 2)
    zero, reference = ca.DM.zeros(2), ca.DM(rest.r)
    inductance = x / plant.omega_0
    drop = ca.DM([[r, -x], [x, r]])

    def current(at: ca.SX) -> ca.SX:
        return dynamics.g(at, zero)

    state = z + ca.DM(x_eq)
    v = ca.SX.sym("v", 2)
    free, i_DQ = dynamics.f(state, zero, reference), current(state)
    to_current = ca.jacobian(i_DQ, z)
    by_voltage = ca.jacobian(dynamics.f(state, v, reference), v)
    voltage = ca.solve(
        ca.SX.eye(2) - inductance * ca.mtimes(to_current, by_voltage),
        v_th + ca.mtimes(drop, i_DQ) + inductance * ca.mtimes(to_current, free),
    )
    rate = ca.Function("rate", [z, v_th], [free + ca.mtimes(by_voltage, voltage)])
    i_eq = np.asarray(dynamics.g(x_eq, [op.v, 0.0])).ravel()
    source = np.array([op.v, 0.0]) - np.asarray(drop) @ i_eq
    return x_eq, rate, source


def _growth(time: np.ndarray, pieces: list[np.ndarray], window: float) -> float:
    """Slope of the logarithm of what moves within each window, over the last half of the windows.

    Not the deviation itself, which ends at another steady state, but its change from one window to
    the next, and its scatter.
    """
    if np.abs(pieces[-1][-1]).max() > LARGE:
        return float(np.log(LARGE / STEP) / time[-1])
    moved = [float(np.linalg.norm(one - one.mean(axis=0))) for one in pieces]
    late = np.log(np.maximum(moved[len(moved) // 2 :], np.finfo(float).tiny))
    return float(np.polyfit(window * np.arange(len(late)), late, 1)[0])
