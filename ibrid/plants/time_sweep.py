"""Sweep by injection: a small sinusoid on the d or q axis of the PCC voltage, simulated until the response is steady.

The nonlinear equations are integrated by SUNDIALS CVODES. Nothing here knows the linearisation: steady state is
recognised by two successive records, the second twice as long as the first, giving the same phasor.
"""

from math import ceil

import casadi as ca
import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.sweep import OperatingPoint
from ibrid.plants.reference import ReferenceInverter

AMPLITUDE = 2e-4
AGREEMENT = 1e-4
SHORTEST_RECORD = 0.02
FEWEST_PERIODS = 4
LONGEST_SIMULATION = 60.0


def injected_admittance(
    plant: ReferenceInverter, op: OperatingPoint, frequency: np.ndarray, *, amplitude: float = AMPLITUDE
) -> np.ndarray:
    """(K, 2, 2) complex: measured Y at `frequency`, (K,) Hz, one simulation per frequency and axis.

    Law: v_DQ = [v, 0] + a sin(omega t) on one axis, from the equilibrium; in each record of whole periods the phasor is
    I = 2 / T integral (1 - cos(2 pi t / T)) i(t) exp(-j omega t) dt, whose Hann window suppresses what still decays at
    other frequencies; Y = I / (-j a).

    amplitude : a, per unit; distortion grows with its square.
    Raises SweepError when the response is not steady after LONGEST_SIMULATION seconds.
    """
    record = _record(plant, op)
    columns = [[_column(record, hz, axis, amplitude, op) for axis in (0, 1)] for hz in np.asarray(frequency)]
    return np.moveaxis(np.array(columns), 1, 2)


def _column(record: ca.Function, hz: float, axis: int, amplitude: float, op: OperatingPoint) -> np.ndarray:
    """(2,) response of i_DQ to a sinusoid on one axis, relative to it."""
    direction = np.eye(2)[axis] * amplitude
    periods = max(FEWEST_PERIODS, ceil(SHORTEST_RECORD * hz))
    state, time, before = 0.0, 0.0, None
    while time < LONGEST_SIMULATION:
        duration = periods / hz
        answer = record(x0=state, p=ca.vertcat(duration, 2 * np.pi * hz, *direction))
        parts = np.asarray(answer["qf"]).ravel()
        phasor = 2 * (parts[:2] + 1j * parts[2:]) / (-1j * amplitude)
        if before is not None and np.linalg.norm(phasor - before) <= AGREEMENT * np.linalg.norm(phasor):
            return phasor
        state, time, before, periods = answer["xf"], time + duration, phasor, 2 * periods
    raise SweepError(
        f"the response at {hz:g} Hz and operating point {op.name} must be steady within {LONGEST_SIMULATION:g} s of "
        "simulation; it was not, sweep by linearisation or choose a better damped operating point."
    )


def _record(plant: ReferenceInverter, op: OperatingPoint) -> ca.Function:
    """Integrator over one record in normalised time, of the deviation from the equilibrium.

    Small deviations keep their own digits; the quadratures are the windowed real and imaginary parts of i_DQ.
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
    # Adams formulas: the motion is oscillatory at the injected frequency, and of a higher order than BDF there
    options = {
        "linear_multistep_method": "adams",
        "abstol": 1e-13,
        "reltol": 1e-9,
        "quad_err_con": True,
        "max_num_steps": 10_000_000,
    }
    return ca.integrator("record", "cvodes", problem, 0.0, 1.0, options)
