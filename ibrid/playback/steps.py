"""The compiled simulation: many parameter sets at once along one measured voltage.

Of a device, by Runge-Kutta steps: as many between two samples as the fastest mode asks for; none crosses a knot of the voltage's
spline. Where a limit sets in or lets go within a step, that step is taken again in parts, and so are these: the law has a kink or
a jump there, and the error is of the order of the part. All parameter sets take the same steps, so that differences are smooth.

Of a program that simulates a device in fixed steps, by its own trapezoidal rule (Dommel, IEEE Trans. Power App. Syst. PAS-88,
1969): x' = x + h/2 (f(x, v) + f(x', v')), one step from sample to sample. Nothing lies between these, and what the rule makes of
fast modes (their frequency w becomes 2/h atan(w h / 2)) is in the record.
"""

import numpy as np
from numba import njit
from scipy.integrate import DOP853, RK45

from ibrid.fit.kernel import OPTIONS

Rule = tuple[np.ndarray, ...]
#: Dormand and Prince's formulas: weights within a step, weights of the step, and times of the stages.
ORDER_8, ORDER_5 = (
    tuple(np.ascontiguousarray(one, dtype=float) for one in (rule.A, rule.B, rule.C)) for rule in (DOP853, RK45)
)
#: Into so many parts a step is divided in which something switches.
DIVIDED = 4
#: Terminal current, per unit, beyond which a simulation has left what any inverter does.
LEFT = 100.0
#: Iterations of a trapezoidal step at most, and the change of a state, per unit, below which it is solved.
ITERATIONS, SOLVED = 30, 1e-13


@njit(**OPTIONS)
def _sum(x, h, weights, stages, k, y):
    """y = x + h sum of weights times the first of the rates k (stages, n S)."""
    y[:] = x
    for stage in range(stages):
        weight = h * weights[stage]
        if weight != 0.0:
            rates = k[stage]
            for place in range(y.size):
                y[place] += weight * rates[place]


@njit(**OPTIONS)
def _at(each, w, lanes, outside, since, t, spline, piece):
    """Everything at the states and the memory in w, `since` s after that was kept, t s after the last sample; outside : place
    of the first number from outside."""
    w[outside : outside + lanes] = since
    for c in range(spline.shape[2]):
        value = ((spline[0, piece, c] * t + spline[1, piece, c]) * t + spline[2, piece, c]) * t + spline[3, piece, c]
        place = outside + (c + 1) * lanes
        w[place : place + lanes] = value
    each(w.ctypes.data, lanes)


@njit(**OPTIONS)
def _step(each, rule, w, lanes, places, x, k, t, h, spline, piece, before):
    """One step in place from t after the last sample; k[0] holds the rates at x and then those behind the step.

    places : of w, as `simulate` has them. before : switches at the end of the last step. True where any differs in between.
    """
    states, memory, rates, following, switches, outside = places
    inner, outer, nodes = rule
    switched = False
    for stage in range(1, nodes.size):
        _sum(x, h, inner[stage], stage, k, states)
        at = nodes[stage] * h
        _at(each, w, lanes, outside, at, t + at, spline, piece)
        k[stage, :] = rates
        for place in range(switches.size):
            switched |= switches[place] != before[place]
    _sum(x, h, outer, nodes.size, k, states)
    x[:] = states
    if memory.size:
        _at(each, w, lanes, outside, h, t + h, spline, piece)
        memory[:] = following
    _at(each, w, lanes, outside, 0.0, t + h, spline, piece)
    k[0, :] = rates
    return switched


@njit(**OPTIONS)
def _keep(delivered, current, left, time, x, start):
    """Write the current delivered (2 S,) into that of a sample (2, S); a simulation that has left stays at its start."""
    lanes = left.size
    for s in range(lanes):
        if np.isnan(left[s]):
            d, q = delivered[s], delivered[lanes + s]
            if d * d + q * q < LEFT * LEFT:
                current[0, s] = d
                current[1, s] = q
            else:
                left[s] = time
        if not np.isnan(left[s]):
            for row in range(start.shape[0]):
                x[row * lanes + s] = start[row, s]


@njit(**OPTIONS)
def simulate(tape, start, kept, constants, spline, time, parts, deepest, rule):
    """Terminal current (N, 2, S) at samples `time` (N,), the time (S,) at which each simulation left, NaN if it did not, and what
    is kept (k, S) at the end.

    tape : once, each, rows of w, the row of the first result. Rows of w, of S numbers, a multiple of `LANES`: states, what is
    kept, (time since, signals), constants; results: rates, current, what is kept next, switches. start : (n, S). kept : (k, S).
    constants : (q, S). spline : (4, N - 1, signals). parts : (N - 1,) steps between samples; one in which something switches is
    divided `deepest` times at most. rule : `ORDER_8` or `ORDER_5`. One that left stays at its start.
    """
    once, each, rows, first = tape
    lanes, number, n, m = constants.shape[1], time.size, start.size, kept.size
    w = np.zeros(rows * lanes)
    outside, results = n + m, first * lanes
    begin = outside + (1 + spline.shape[2]) * lanes
    states, memory, rates = w[:n], w[n:outside], w[results : results + n]
    now = results + n
    following, switches = w[now + 2 * lanes : now + 2 * lanes + m], w[now + 2 * lanes + m :]
    places = states, memory, rates, following, switches, outside
    states[:], memory[:] = start.reshape(n), kept.reshape(m)
    w[begin : begin + constants.size] = constants.reshape(constants.size)
    once(w.ctypes.data, lanes)
    x, k = states.copy(), np.zeros((rule[2].size, n))
    rates_old, x_old, memory_old, before = np.empty(n), np.empty(n), np.empty(m), np.empty(switches.size)
    current = np.full((number, 2, lanes), np.nan)
    left = np.full(lanes, np.nan)
    _at(each, w, lanes, outside, 0.0, 0.0, spline, 0)
    k[0, :] = rates
    before[:] = switches
    whole = DIVIDED**deepest
    for sample in range(number):
        _keep(w[now : now + 2 * lanes], current[sample], left, time[sample], x, start)
        if sample == number - 1:
            break
        h = (time[sample + 1] - time[sample]) / parts[sample]
        for part in range(parts[sample]):
            done, length = 0, whole
            while done < whole:
                x_old[:], memory_old[:], rates_old[:] = x, memory, k[0]
                t, short = (part + done / whole) * h, h * length / whole
                switched = _step(each, rule, w, lanes, places, x, k, t, short, spline, sample, before)
                if switched and length > 1:
                    x[:], memory[:], k[0, :] = x_old, memory_old, rates_old
                    length //= DIVIDED
                    continue
                before[:] = switches
                done += length
                while length < whole and done % (length * DIVIDED) == 0:
                    length *= DIVIDED
    return current, left, memory.copy().reshape(kept.shape)


@njit(**OPTIONS)
def simulate_in_fixed_steps(tape, start, kept, constants, spline, time, h, inverse):
    """The same by one trapezoidal step from sample to sample.

    h : s from sample to sample. inverse : (n, n) of I - h/2 A, A the state matrix at rest, for the slopes of Newton's iterations.
    """
    once, each, rows, first = tape
    lanes, number, n, m = constants.shape[1], time.size, start.size, kept.size
    w = np.zeros(rows * lanes)
    outside, results = n + m, first * lanes
    begin = outside + (1 + spline.shape[2]) * lanes
    states, memory, rates = w[:n], w[n:outside], w[results : results + n]
    now = results + n
    following = w[now + 2 * lanes : now + 2 * lanes + m]
    states[:], memory[:] = start.reshape(n), kept.reshape(m)
    w[begin : begin + constants.size] = constants.reshape(constants.size)
    once(w.ctypes.data, lanes)
    x, before, error = states.copy(), np.empty(n), np.empty(n)
    current = np.full((number, 2, lanes), np.nan)
    left = np.full(lanes, np.nan)
    _at(each, w, lanes, outside, 0.0, 0.0, spline, 0)
    before[:] = rates
    for sample in range(number):
        _keep(w[now : now + 2 * lanes], current[sample], left, time[sample], x, start)
        if sample == number - 1:
            break
        t = time[sample + 1] - time[sample]  # as the file has it, rounded
        states[:] = x
        for _ in range(ITERATIONS):
            _at(each, w, lanes, outside, h, t, spline, sample)
            for place in range(n):
                error[place] = states[place] - x[place] - 0.5 * h * (before[place] + rates[place])
            largest = 0.0
            for row in range(start.shape[0]):
                for s in range(lanes):
                    change = 0.0
                    for column in range(start.shape[0]):
                        change += inverse[row, column] * error[column * lanes + s]
                    states[row * lanes + s] -= change
                    if np.isnan(left[s]):
                        largest = max(largest, abs(change))
            if not largest > SOLVED:
                break
        x[:] = states
        _at(each, w, lanes, outside, h, t, spline, sample)
        before[:] = rates
        if m:
            memory[:] = following
    return current, left, memory.copy().reshape(kept.shape)
