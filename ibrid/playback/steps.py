"""The compiled simulation: many parameter sets at once along one measured voltage.

Of a device, by Runge-Kutta steps: as many between two samples as the fastest mode asks for; none
crosses a knot of the voltage's spline. Where a limit sets in or lets go within a step, that step is
taken again in parts, and so are these: the law has a kink or a jump there, and the error is of the
order of the part. All parameter sets take the same steps, so that differences are smooth.

Of a program that simulates a device in fixed steps, by its own trapezoidal rule (Dommel, IEEE
Trans. Power App. Syst. PAS-88, 1969): x' = x + h/2 (f(x, v) + f(x', v')), one step from sample to
sample. Nothing lies between these, and what the rule makes of fast modes (their frequency w becomes
2/h atan(w h / 2)) is in the record.

All numbers stand in one array, and loops name their places: a slice in every stage takes as long as
the law itself.
"""

import numpy as np
from scipy.integrate import DOP853, RK45

from ibrid.fit.just_in_time import OPTIONS, njit

Rule = tuple[np.ndarray, ...]
#: Dormand and Prince's formulas: weights within a step, weights of the step, and times of the
#: stages.
ORDER_8, ORDER_5 = (
    tuple(np.ascontiguousarray(one, dtype=float) for one in (rule.A, rule.B, rule.C))
    for rule in (DOP853, RK45)
)
#: Into so many parts a step is divided in which something switches.
DIVIDED = 4
#: Terminal current, per unit, beyond which a simulation has left what any inverter does.
LEFT = 100.0
#: Iterations of a trapezoidal step at most, and the change of a state, per unit, below which it is
#: solved.
ITERATIONS, SOLVED = 30, 1e-12


@njit(**OPTIONS)
def _sum(w, x, h, weights, stages, k):
    """w = x + h sum of weights times the first of the rates k (stages, n S), in the first places of
    w.
    """
    for place in range(x.size):
        w[place] = x[place]
    for stage in range(stages):
        weight = h * weights[stage]
        if weight != 0.0:
            for place in range(x.size):
                w[place] += weight * k[stage, place]


@njit(**OPTIONS)
def _at(each, address, w, lanes, outside, since, t, spline, piece):
    """Everything at the states and the memory in w, `since` s after that was kept, t s after the
    last sample; outside : place of the first number from outside.
    """
    for place in range(outside, outside + lanes):
        w[place] = since
    for c in range(spline.shape[2]):
        value = (
            (spline[0, piece, c] * t + spline[1, piece, c]) * t + spline[2, piece, c]
        ) * t + spline[3, piece, c]
        first = outside + (c + 1) * lanes
        for place in range(first, first + lanes):
            w[place] = value
    each(address, lanes)


@njit(**OPTIONS)
def _copy(source, first, target):
    """target = what stands in the source from a place on."""
    for place in range(target.size):
        target[place] = source[first + place]


@njit(**OPTIONS)
def _step(each, rule, w, address, lanes, places, x, k, t, h, spline, piece, before):
    """One step in place from t after the last sample; k[0] holds the rates at x and then those
    behind the step.

    places : of w, as `_begun` has them. before : switches at the end of the last step. True where
    any differs in between.
    """
    memory, outside, rates, following, switches = places
    inner, outer, nodes = rule
    n = x.size
    switched = False
    for stage in range(1, nodes.size):
        _sum(w, x, h, inner[stage], stage, k)
        at = nodes[stage] * h
        _at(each, address, w, lanes, outside, at, t + at, spline, piece)
        for place in range(n):
            k[stage, place] = w[rates + place]
        for place in range(before.size):
            switched |= w[switches + place] != before[place]
    _sum(w, x, h, outer, nodes.size, k)
    for place in range(n):
        x[place] = w[place]
    if outside > memory:
        _at(each, address, w, lanes, outside, h, t + h, spline, piece)
        for place in range(outside - memory):
            w[memory + place] = w[following + place]
    _at(each, address, w, lanes, outside, 0.0, t + h, spline, piece)
    for place in range(n):
        k[0, place] = w[rates + place]
    return switched


@njit(**OPTIONS)
def _keep(w, now, current, sample, left, time, x, start):
    """Write the current delivered, from w[now] on, into that of a sample (N, 2, S); a simulation
    that has left stays at its start.
    """
    lanes = left.size
    for s in range(lanes):
        if np.isnan(left[s]):
            d, q = w[now + s], w[now + lanes + s]
            if d * d + q * q < LEFT * LEFT:
                current[sample, 0, s] = d
                current[sample, 1, s] = q
            else:
                left[s] = time[sample]
        if not np.isnan(left[s]):
            for row in range(start.shape[0]):
                x[row * lanes + s] = start[row, s]


@njit(**OPTIONS)
def _begun(tape, start, kept, constants, spline, number):
    """The law of every step, all numbers w and the states x at the beginning; the places in w of
    memory, outside, rates, following, switches; and the current of `number` samples and the times
    of leaving, unknown yet.
    """
    once, each, rows, first = tape
    lanes, n, m = constants.shape[1], start.size, kept.size
    w = np.zeros(rows * lanes)
    outside, rates = n + m, first * lanes
    begin = outside + (1 + spline.shape[2]) * lanes
    following = rates + n + 2 * lanes
    w[:n], w[n:outside] = start.reshape(n), kept.reshape(m)
    w[begin : begin + constants.size] = constants.reshape(constants.size)
    once(w.ctypes.data, lanes)
    x = w[:n].copy()
    _at(each, w.ctypes.data, w, lanes, outside, 0.0, 0.0, spline, 0)
    current = np.full((number, 2, lanes), np.nan)
    places = (n, outside, rates, following, following + m)
    return each, w, x, places, current, np.full(lanes, np.nan)


@njit(**OPTIONS)
def simulate(tape, start, kept, constants, spline, time, parts, deepest, rule):
    """Terminal current (N, 2, S) at samples `time` (N,), the time (S,) at which each simulation
    left, NaN if it did not, and what is kept (k, S) at the end.

    tape : once, each, rows of w, the row of the first result. Rows of w, of S numbers, a multiple
    of `LANES`: states, what is kept, (time since, signals), constants; results: rates, current,
    what is kept next, switches. start : (n, S). kept : (k, S).
    constants : (q, S). spline : (4, N - 1, signals). parts : (N - 1,) steps between samples; one in
    which something switches is divided `deepest` times at most. rule : `ORDER_8` or `ORDER_5`. One
    that left stays at its start.
    """
    number, n = time.size, start.size
    each, w, x, places, current, left = _begun(tape, start, kept, constants, spline, number)
    address, lanes = w.ctypes.data, left.size
    memory, outside, rates, _, switches = places
    k = np.zeros((rule[2].size, n))
    rates_old, x_old, memory_old, before = (
        np.empty(n),
        np.empty(n),
        np.empty(outside - memory),
        np.empty(w.size - switches),
    )
    _copy(w, rates, k[0])
    _copy(w, switches, before)
    whole = DIVIDED**deepest
    for sample in range(number):
        _keep(w, rates + n, current, sample, left, time, x, start)
        if sample == number - 1:
            break
        h = (time[sample + 1] - time[sample]) / parts[sample]
        for part in range(parts[sample]):
            done, length = 0, whole
            while done < whole:
                if before.size:
                    _copy(x, 0, x_old)
                    _copy(w, memory, memory_old)
                    _copy(k[0], 0, rates_old)
                t, short = (part + done / whole) * h, h * length / whole
                switched = _step(
                    each, rule, w, address, lanes, places, x, k, t, short, spline, sample, before
                )
                if switched and length > 1:
                    x[:], w[memory:outside], k[0, :] = x_old, memory_old, rates_old
                    length //= DIVIDED
                    continue
                _copy(w, switches, before)
                done += length
                while length < whole and done % (length * DIVIDED) == 0:
                    length *= DIVIDED
    return current, left, w[memory:outside].copy().reshape(kept.shape)


@njit(**OPTIONS)
def _solve(inverse, error, change, lanes):
    """change = inverse error : (n, n) times (n, S)."""
    if lanes == 4:
        _solve_four(inverse, error, change)
        return
    n = inverse.shape[0]
    for row in range(n):
        first = row * lanes
        for s in range(lanes):
            change[first + s] = 0.0
        for column in range(n):
            entry = inverse[row, column]
            for s in range(lanes):
                change[first + s] += entry * error[column * lanes + s]


@njit(**OPTIONS)
def _solve_four(inverse, error, change):
    """The same of four columns: a loop over so few takes as long as what it sums."""
    n = inverse.shape[0]
    for row in range(n):
        first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
        for column in range(n):
            entry, place = inverse[row, column], 4 * column
            first += entry * error[place]
            second += entry * error[place + 1]
            third += entry * error[place + 2]
            fourth += entry * error[place + 3]
        place = 4 * row
        change[place], change[place + 1], change[place + 2], change[place + 3] = (
            first,
            second,
            third,
            fourth,
        )


@njit(**OPTIONS)
def simulate_in_fixed_steps(tape, start, kept, constants, spline, time, h, inverse):
    """The same by one trapezoidal step from sample to sample.

    h : s from sample to sample. inverse : (n, n) of I - h/2 A, A the state matrix at rest, for the
    slopes of Newton's iterations.
    """
    number, n = time.size, start.size
    each, w, x, places, current, left = _begun(tape, start, kept, constants, spline, number)
    address, lanes = w.ctypes.data, left.size
    memory, outside, rates, following, _ = places
    before, error, change, moved = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)
    _copy(w, rates, before)
    for sample in range(number):
        _keep(w, rates + n, current, sample, left, time, x, start)
        if sample == number - 1:
            break
        t = time[sample + 1] - time[sample]  # as the file has it, rounded
        for place in range(n):  # begun where the step before leads
            w[place] = x[place] + moved[place]
        for _ in range(ITERATIONS):
            _at(each, address, w, lanes, outside, h, t, spline, sample)
            for place in range(n):
                error[place] = w[place] - x[place] - 0.5 * h * (before[place] + w[rates + place])
            _solve(inverse, error, change, lanes)
            largest = 0.0
            for first in range(0, n, lanes):
                for s in range(lanes):
                    w[first + s] -= change[first + s]
                    if np.isnan(left[s]):
                        largest = max(largest, abs(change[first + s]))
            if not largest > SOLVED:
                break
        for place in range(n):
            moved[place] = w[place] - x[place]
        _copy(w, 0, x)
        _at(each, address, w, lanes, outside, h, t, spline, sample)
        _copy(w, rates, before)
        for place in range(outside - memory):
            w[memory + place] = w[following + place]
    return current, left, w[memory:outside].copy().reshape(kept.shape)
