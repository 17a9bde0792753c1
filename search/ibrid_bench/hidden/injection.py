"""A hidden device measured as on a test bench: sinusoids of finite amplitude on the PCC voltage,
simulated in time.

The averaged nonlinear equations are integrated from the steady state until two successive records,
the second twice as long, give the same first harmonic. Nothing here is linearised.
"""

from functools import cache
from math import ceil, pi

import casadi as ca
import numpy as np
from ibrid_bench.hidden.compiled import Record, compiled, recorder
from ibrid_bench.hidden.device import OMEGA_60, power_node_of
from ibrid_bench.hidden.equations import equations
from ibrid_bench.hidden.nonlinear import Nonlinearity
from ibrid_bench.hidden.parameters import Device, Structure
from ibrid_bench.hidden.rest import at_rest

from ibrid.errors import IbridError, SweepError
from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode

#: Longest step (s) and fewest steps of a period.
STEP, STEPS = 2e-5, 64
#: Fewest periods and shortest duration (s) of the first record.
PERIODS, SHORTEST = 4, 0.1
#: Relative difference of two records that are the same, and the longest simulation (s).
AGREEMENT, LONGEST = 1e-4, 20.0


def injected(
    device: Device,
    nonlinearity: Nonlinearity,
    op: OperatingPoint,
    frequency_hz: np.ndarray,
    amplitude: float,
    omega_0: float = OMEGA_60,
    *,
    power_node: PowerNode | None = None,
) -> np.ndarray:
    """(K, 2, 2) complex: first harmonic of i_DQ over the injected one, d and q axis in turn;
    amplitude per unit.

    Raises IbridError for a device with a delay, whose loops cannot be closed without one, or one
    that the limit keeps from its operating point; SweepError where the response never becomes
    steady.
    """
    rest = at_rest(device, op, power_node or power_node_of(device), omega_0)
    if device.T_d or any(
        one is not None for one in (device.comb_gain, device.T_current, device.T_hold)
    ):
        raise IbridError(
            "a device that is simulated in time must have no delay; choose another base."
        )
    record = _recorder(device.structure)
    a = np.array([*rest.r, *device.numbers.values(), *nonlinearity.thresholds, omega_0])
    v = np.array([op.v, 0.0])
    columns = [
        [
            _column(record, rest.x, v, a, float(hz), amplitude * np.eye(2)[axis], op)
            for axis in (0, 1)
        ]
        for hz in np.asarray(frequency_hz)
    ]
    return np.moveaxis(np.array(columns), 1, 2)


def _column(
    record: Record,
    x: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    hz: float,
    direction: np.ndarray,
    op: OperatingPoint,
) -> np.ndarray:
    """(2,) response of i_DQ to a sinusoid on one axis, relative to it."""
    x, time, before = x.copy(), 0.0, None
    period = max(STEPS, ceil(1.0 / (hz * STEP)))
    step = 1.0 / (hz * period)
    periods = max(PERIODS, ceil(SHORTEST * hz))
    wave = np.array([2 * pi * hz, *direction])
    while time < LONGEST:
        sums = record(x, time, wave, v, a, step, periods * period) * 2.0 / (periods * period)
        if not np.isfinite(sums).all():
            break
        phasor = (sums[:2] - 1j * sums[2:]) / (-1j * np.linalg.norm(direction))
        if before is not None and np.linalg.norm(phasor - before) <= AGREEMENT * np.linalg.norm(
            phasor
        ):
            return phasor
        time, before, periods = time + periods / hz, phasor, 2 * periods
    raise SweepError(
        f"the response at {hz:g} Hz and operating point {op.name} must become steady within "
        f"{LONGEST:g} s; it did not "
        f"with an amplitude of {np.linalg.norm(direction):g}, take a smaller one or another device."
    )


@cache
def _recorder(structure: Structure) -> Record:
    """The compiled loop of one structure; its arguments a are set-points, numbers of the device,
    thresholds, omega_0.
    """
    eq = equations(structure, nonlinear=True)
    x, v, a = ca.SX.sym("x", len(eq.states)), ca.SX.sym("v", 2), ca.SX.sym("a", 2 + len(eq.numbers))
    r, numbers = a[:2], a[2:]
    s = ca.SX.sym("s", eq.cut)
    _, s_out, _ = eq.moving(x, s, v, r, numbers)
    if ca.depends_on(s_out, s):
        raise IbridError(
            "the command of this device depends on itself without a delay; choose another base."
        )
    x_dot, _, i_DQ = eq.moving(x, s_out, v, r, numbers)
    function = ca.Function("motion", [x, v, a], [ca.densify(x_dot), ca.densify(i_DQ)])
    return recorder(compiled(function), len(eq.states))
