"""The compiled simulation: Runge-Kutta steps of many parameter sets at once along one measured voltage.

As many steps between two samples as the fastest mode asks for; none crosses a knot of the voltage's spline.
Where a limit sets in or lets go within a step, that step is taken again in parts, and so are these: the law has a kink or a
jump there, and the error is of the order of the part. All parameter sets take the same steps, so that differences are smooth.
"""

import numpy as np
from numba import njit
from scipy.integrate import DOP853, RK45

from ibrid.fit.kernel import OPTIONS
from ibrid.playback.tape import OPERATIONS

Rule = tuple[np.ndarray, ...]
#: Dormand and Prince's formulas: weights within a step, weights of the step, and times of the stages.
ORDER_8, ORDER_5 = (
    tuple(np.ascontiguousarray(one, dtype=float) for one in (rule.A, rule.B, rule.C)) for rule in (DOP853, RK45)
)
#: Into so many parts a step is divided in which something switches.
DIVIDED = 4
#: Terminal current, per unit, beyond which a simulation has left what any inverter does.
LEFT = 100.0

(_ASSIGN, _NEG, _TWICE, _SQ, _SQRT, _INV, _SIN, _COS, _EXP, _LOG, _NOT, _FABS, _SIGN, _TANH, _ATAN,
 _ADD, _SUB, _MUL, _DIV, _POW, _CONSTPOW, _LT, _LE, _EQ, _NE, _AND, _OR, _FMIN, _FMAX, _IF, _ATAN2, _HYPOT
) = OPERATIONS.values()  # fmt: skip


@njit(**OPTIONS)
def _run(code, first, last, w):
    """Operations on the columns of w (places, S)."""
    lanes = w.shape[1]
    for k in range(first, last):
        operation, o, i, j = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if operation == _MUL:
            for s in range(lanes):
                w[o, s] = w[i, s] * w[j, s]
        elif operation == _ADD:
            for s in range(lanes):
                w[o, s] = w[i, s] + w[j, s]
        elif operation == _SUB:
            for s in range(lanes):
                w[o, s] = w[i, s] - w[j, s]
        elif operation == _DIV:
            for s in range(lanes):
                w[o, s] = w[i, s] / w[j, s]
        elif operation == _NEG:
            for s in range(lanes):
                w[o, s] = -w[i, s]
        elif operation == _SQ:
            for s in range(lanes):
                w[o, s] = w[i, s] * w[i, s]
        elif operation == _SQRT:
            for s in range(lanes):
                w[o, s] = np.sqrt(w[i, s])
        elif operation == _INV:
            for s in range(lanes):
                w[o, s] = 1.0 / w[i, s]
        elif operation == _SIN:
            for s in range(lanes):
                w[o, s] = np.sin(w[i, s])
        elif operation == _COS:
            for s in range(lanes):
                w[o, s] = np.cos(w[i, s])
        elif operation == _LT:
            for s in range(lanes):
                w[o, s] = 1.0 if w[i, s] < w[j, s] else 0.0
        elif operation == _LE:
            for s in range(lanes):
                w[o, s] = 1.0 if w[i, s] <= w[j, s] else 0.0
        elif operation == _IF:
            for s in range(lanes):
                w[o, s] = w[j, s] if w[i, s] != 0.0 else 0.0
        elif operation == _FMIN:
            for s in range(lanes):
                w[o, s] = min(w[i, s], w[j, s])
        elif operation == _FMAX:
            for s in range(lanes):
                w[o, s] = max(w[i, s], w[j, s])
        elif operation == _NOT:
            for s in range(lanes):
                w[o, s] = 1.0 if w[i, s] == 0.0 else 0.0
        elif operation == _AND:
            for s in range(lanes):
                w[o, s] = 1.0 if w[i, s] != 0.0 and w[j, s] != 0.0 else 0.0
        elif operation == _OR:
            for s in range(lanes):
                w[o, s] = 1.0 if w[i, s] != 0.0 or w[j, s] != 0.0 else 0.0
        else:
            for s in range(lanes):
                w[o, s] = _seldom(operation, w[i, s], w[j, s])


@njit(**OPTIONS)
def _seldom(operation, a, b):
    if operation == _ASSIGN:
        return a
    if operation == _TWICE:
        return 2.0 * a
    if operation == _EXP:
        return np.exp(a)
    if operation == _LOG:
        return np.log(a)
    if operation in (_POW, _CONSTPOW):
        return a**b
    if operation == _EQ:
        return 1.0 if a == b else 0.0
    if operation == _NE:
        return 1.0 if a != b else 0.0
    if operation == _FABS:
        return abs(a)
    if operation == _SIGN:
        return np.sign(a)
    if operation == _ATAN2:
        return np.arctan2(a, b)
    if operation == _HYPOT:
        return np.hypot(a, b)
    if operation == _TANH:
        return np.tanh(a)
    return np.arctan(a)


@njit(**OPTIONS)
def _fill(w, places, values):
    for row in range(places.size):
        if places[row] >= 0:
            for s in range(w.shape[1]):
                w[places[row], s] = values[row, s]


@njit(**OPTIONS)
def _take(w, places, values):
    for row in range(places.size):
        for s in range(w.shape[1]):
            values[row, s] = w[places[row], s]


@njit(**OPTIONS)
def _sum(x, h, weights, stages, k, y):
    """y = x + h sum of weights times the first of the rates k (stages, n, S)."""
    y[:] = x
    for stage in range(stages):
        weight = h * weights[stage]
        if weight != 0.0:
            for row in range(x.shape[0]):
                for s in range(x.shape[1]):
                    y[row, s] += weight * k[stage, row, s]


@njit(**OPTIONS)
def _at(tape, w, y, m, since, t, spline, piece):
    """Everything at states y and memory m, `since` s after that was kept, t s after the last sample."""
    code, before, x_at, m_at, outside_at = tape[0], tape[1], tape[2], tape[3], tape[4]
    _fill(w, x_at, y)
    _fill(w, m_at, m)
    for row in range(outside_at.size):
        value = since
        if row > 0:
            c = row - 1
            value = ((spline[0, piece, c] * t + spline[1, piece, c]) * t + spline[2, piece, c]) * t + spline[
                3, piece, c
            ]
        if outside_at[row] >= 0:
            for s in range(w.shape[1]):
                w[outside_at[row], s] = value
    _run(code, before, code.shape[0], w)


@njit(**OPTIONS)
def _step(tape, rule, w, x, m, k, t, h, spline, piece, y, before, now):
    """One step in place from t after the last sample; k[0] holds the rates at x and then those behind the step.

    before, now : switches at the end of the last step, and of this one. True where any differs in between.
    """
    rates_at, next_at, switch_at = tape[5], tape[7], tape[8]
    inner, outer, nodes = rule
    switched = False
    for stage in range(1, nodes.size):
        _sum(x, h, inner[stage], stage, k, y)
        at = nodes[stage] * h
        _at(tape, w, y, m, at, t + at, spline, piece)
        _take(w, rates_at, k[stage])
        _take(w, switch_at, now)
        for row in range(switch_at.size):
            for s in range(w.shape[1]):
                switched |= now[row, s] != before[row, s]
    _sum(x, h, outer, nodes.size, k, y)
    x[:] = y
    if next_at.size:
        _at(tape, w, x, m, h, t + h, spline, piece)
        _take(w, next_at, m)
    _at(tape, w, x, m, 0.0, t + h, spline, piece)
    _take(w, rates_at, k[0])
    return switched


@njit(**OPTIONS)
def simulate(tape, size, literal_at, literal, constants_at, constants, x, m, spline, time, parts, deepest, reset, rule):
    """Terminal current (N, 2, S) at samples `time` (N,), and the time (S,) at which each simulation left, NaN if it did not.

    tape : (code, before, places of x, of m, of (time since, signals), of rates, of the current, of the next m, of switches).
    constants : (q, S). x : (n, S), m : (k, S), at the start; both are changed. spline : (4, N - 1, k), of the signals.
    parts : (N - 1,) steps between samples; one in which something switches is divided `deepest` times at most.
    reset : (n, S) where a simulation that left stays. rule : `ORDER_8` or `ORDER_5`.
    """
    code, constant, rates_at, current_at, switch_at = tape[0], tape[1], tape[5], tape[6], tape[8]
    lanes, number = constants.shape[1], time.size
    w = np.zeros((size, lanes))
    for row in range(literal_at.size):
        w[literal_at[row], :] = literal[row]
    _fill(w, constants_at, constants)
    _run(code, 0, constant, w)
    rates = np.zeros((rule[2].size, x.shape[0], lanes))
    y, rates_old, x_old, m_old = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(m)
    now, before = np.zeros((switch_at.size, lanes)), np.zeros((switch_at.size, lanes))
    current = np.full((number, 2, lanes), np.nan)
    left = np.full(lanes, np.nan)
    _at(tape, w, x, m, 0.0, 0.0, spline, 0)
    _take(w, rates_at, rates[0])
    _take(w, switch_at, before)
    whole = DIVIDED**deepest
    for k in range(number):
        for s in range(lanes):
            if np.isnan(left[s]):
                d, q = w[current_at[0], s], w[current_at[1], s]
                if d * d + q * q < LEFT * LEFT:
                    current[k, 0, s] = d
                    current[k, 1, s] = q
                else:
                    left[s] = time[k]
            if not np.isnan(left[s]):
                for row in range(x.shape[0]):
                    x[row, s] = reset[row, s]
        if k == number - 1:
            break
        h = (time[k + 1] - time[k]) / parts[k]
        for part in range(parts[k]):
            done, length = 0, whole
            while done < whole:
                x_old[:], m_old[:], rates_old[:] = x, m, rates[0]
                begin = (part + done / whole) * h
                switched = _step(tape, rule, w, x, m, rates, begin, h * length / whole, spline, k, y, before, now)
                if switched and length > 1:
                    x[:], m[:], rates[0] = x_old, m_old, rates_old
                    length //= DIVIDED
                    continue
                before[:] = now
                done += length
                while length < whole and done % (length * DIVIDED) == 0:
                    length *= DIVIDED
    return current, left
