"""A grid-following inverter with limits, written from the laws alone: plain numbers, short steps of
a Runge-Kutta method.

Nothing is shared with the package: LCL or L filter in the PLL's frame, power loops, current
control, and around it voltage support, reference ramp, momentary cessation, current limit and
command limit as the contract of the events says. Frame: e on d.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import cos, hypot, inf, sin
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import RK45
from scipy.interpolate import CubicSpline

from ibrid.fit.just_in_time import njit

OMEGA = 120 * np.pi
#: Largest step, s: kinks of the laws are met by short steps, jumps by the control of the error.
STEP = 2.5e-6
#: Relative and absolute error of a step, per unit.
RELATIVE, ABSOLUTE = 1e-8, 1e-10
#: Names of states.
STATES = (
    "i_d",
    "i_q",
    "e_d",
    "e_q",
    "g_d",
    "g_q",
    "delta",
    "phi",
    "filtered",
    "x_p",
    "x_q",
    "y_d",
    "y_q",
    "fed_d",
    "fed_q",
)
#: Numbers that a device need not have: 1/s, s, per unit, rad/s; 0 is none.
OPTIONAL = ("w_pll", "delay", "k_damping", "w_feedforward")


@dataclass(frozen=True)
class Device:
    """`numbers` : L_F R_F C_F L_g R_g kP_pll kI_pll kP kI kP_c kI_c feedforward decoupling, per
    unit, 1/s, rad/s, and of `OPTIONAL` what it has: corners of the low-passes before the PLL and of
    the feedforward, the delay of the whole command, the gain of the capacitor's current taken from
    it. C_F = 0 : an L filter, L_F and R_F alone between the inverter and the PCC, whose voltage is
    seen.

    `limits` : id -> its parameters, "mode" and "windup" among them.
    """

    numbers: Mapping[str, float]
    limits: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def at_rest(device: Device, p: float, q: float, v: float) -> tuple[list[float], dict[str, float]]:
    """States at rest with p, q delivered at the capacitor, and the set-points; ValueError where
    there is no such point.
    """
    n = device.numbers
    R, X = (n["R_g"], n["L_g"]) if n["C_F"] else (0.0, 0.0)
    b = v * v + 2 * (R * p + X * q)
    root = b * b - 4 * (R * R + X * X) * (p * p + q * q)
    if root < 0:
        raise ValueError("no operating point")
    e = ((b + root**0.5) / 2) ** 0.5
    g = complex(p, -q) / e
    i = g + 1j * n["C_F"] * e
    u = e + (n["R_F"] + 1j * n["L_F"]) * i
    grid = e - (R + 1j * X) * g
    own = n["feedforward"] * e + 1j * n["decoupling"] * i - n.get("k_damping", 0.0) * (i - g)
    y = u - own  # what the current controller gives
    return [
        i.real,
        i.imag,
        e,
        0.0,
        g.real,
        g.imag,
        float(-np.angle(grid)),
        0.0,
        0.0,
        i.real / n["kI"],
        i.imag / n["kI"],
        y.real / n["kI_c"],
        y.imag / n["kI_c"],
        e,
        0.0,
    ], {"p": p, "q": q, "e": e}


def simulate(
    device: Device,
    point: tuple[float, float, float],
    time: np.ndarray,
    v: np.ndarray,
    *,
    trapezoidal: bool = False,
) -> np.ndarray:
    """(N, 2) current into the grid at `time`; v (N, 2) at the PCC, a cubic spline between.
    ValueError where it leaves.

    trapezoidal : one step of the trapezoidal rule from sample to sample, as programs of
    electromagnetic transients take it.
    """
    x, wanted = at_rest(device, *point)
    law, x, time = _law(device, wanted), np.array(x), np.asarray(time, float)
    if trapezoidal:
        states = _in_fixed_steps(law, x, time, np.ascontiguousarray(v, dtype=float))
    else:
        states = _travelled(
            law, x, time, np.ascontiguousarray(np.moveaxis(CubicSpline(time, v).c, 0, 1))
        )
    if not len(states):
        raise ValueError("it leaves")
    return np.array([_out(device, state) for state in states])


@dataclass(frozen=True, eq=False)
class Linear:
    """A device at rest, its delay cut open: x' = A x + B (v, u), (i, command) = C x + D (v, u), u
    the command `delay` s ago.

    v, i : at the PCC, d and q. No limit acts.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    delay: float

    def response(self, frequency: np.ndarray, step: float = 0.0) -> np.ndarray:
        """(K, 2, 2) from v to i at frequencies, Hz; step : of the trapezoidal rule, s, which takes
        (2/h) tanh(s h/2) for s.
        """
        answers = []
        for s in 2j * np.pi * frequency:
            rate = 2.0 / step * np.tanh(0.5 * s * step) if step else s
            whole = self.c @ np.linalg.solve(rate * np.eye(len(self.a)) - self.a, self.b) + self.d
            late = np.exp(-s * self.delay)
            loop = np.linalg.solve(np.eye(2) - late * whole[2:, 2:], late * whole[2:, :2])
            answers.append(whole[:2, :2] + whole[:2, 2:] @ loop)
        return np.array(answers)


def linear(device: Device, point: tuple[float, float, float]) -> Linear:
    """A device at rest, by differences."""
    x, wanted = at_rest(Device(device.numbers), *point)
    has = device.numbers
    lacks = [
        *(() if has["C_F"] else ("e_d", "e_q", "g_d", "g_q")),
        *(() if has.get("w_pll") else ("filtered",)),
        *(() if has.get("w_feedforward") else ("fed_d", "fed_q")),
    ]
    keep = [k for k, name in enumerate(STATES) if name not in lacks]
    law, delay, rest = _law(Device(device.numbers), wanted), has.get("delay", 0.0), np.array(x)

    def answers(x: np.ndarray, outside: np.ndarray) -> np.ndarray:
        memory, rates = _fresh(0.0, x), np.empty(len(x))
        v_D, v_Q = outside[:2]
        u = _command(law, 0.0, x, v_D, v_Q, memory, np.empty(4))
        _rates(law, x, v_D, v_Q, outside[2:] if delay else u, memory, rates)
        return np.concatenate([rates, _out(device, x), u])

    at_rest_u = _command(law, 0.0, rest, point[2], 0.0, _fresh(0.0, rest), np.empty(4))
    outside = np.array([point[2], 0.0, *at_rest_u])
    by_x = _slopes(lambda move: answers(rest + move, outside), len(rest))
    by_outside = _slopes(lambda move: answers(rest, outside + move), 4)
    n = len(rest)
    return Linear(
        by_x[:n][np.ix_(keep, keep)], by_outside[:n][keep], by_x[n:, keep], by_outside[n:], delay
    )


def _slopes(
    answer: Callable[[np.ndarray], np.ndarray], size: int, step: float = 1e-6
) -> np.ndarray:
    moves = step * np.eye(size)
    return np.array([answer(move) - answer(-move) for move in moves]).T / (2 * step)


def poles(device: Device, point: tuple[float, float, float]) -> np.ndarray:
    """Of a device without a delay at rest, 1/s."""
    return np.linalg.eigvals(linear(device, point).a)


def _out(device: Device, x: np.ndarray) -> tuple[float, float]:
    c, s = cos(x[6]), sin(x[6])
    g_d, g_q = x[4:6] if device.numbers["C_F"] else x[:2]
    return c * g_d - s * g_q, s * g_d + c * g_q


class _Law(NamedTuple):
    """All numbers of a device; a limit that it lacks lies where nothing reaches it."""

    L_F: float
    R_F: float
    C_F: float
    L_g: float
    R_g: float
    kP_pll: float
    kI_pll: float
    w_pll: float
    w_feedforward: float
    delay: float
    k_damping: float
    kP: float
    kI: float
    kP_c: float
    kI_c: float
    feedforward: float
    decoupling: float
    p: float
    q: float
    e: float
    v_freeze: float
    k: float
    dead: float
    ramp: float
    v_block: float
    t_hold: float
    back: float
    i_max: float
    first: float
    i_windup: float
    u_max: float
    u_windup: float


def _law(device: Device, wanted: Mapping[str, float]) -> _Law:
    limits: Mapping[str, Mapping[str, Any]] = device.limits
    support, cease = limits.get("voltage_support", {}), limits.get("momentary_cessation", {})
    limit, command = limits.get("current_limit", {}), limits.get("command_limit", {})
    law = {
        "v_freeze": limits.get("pll_freeze", {}).get("v_freeze", 0.0),
        "k": support.get("k", 0.0),
        "dead": support.get("dead", 0.0),
        "ramp": limits.get("reference_ramp", {}).get("ramp", inf),
        "v_block": cease.get("v_block", 0.0),
        "t_hold": cease.get("t_hold", 0.0),
        "back": cease.get("ramp", 0.0),
        "i_max": limit.get("i_max", inf),
        "first": ("magnitude", "d", "q").index(limit.get("mode", "magnitude")),
        "i_windup": limit.get("windup", False),
        "u_max": command.get("u_max", inf),
        "u_windup": command.get("windup", False),
    }
    every = {**dict.fromkeys(OPTIONAL, 0.0), **device.numbers, **wanted, **law}
    return _Law(*(float(every[name]) for name in _Law._fields))


#: Where a device remembers: when its voltage was last below v_block, and when and where the ramp
#: began its last step; and the reference of the current.
_BELOW, _SINCE, _FROM, _RAMPED, _R_D, _R_Q = range(6)
#: Commands that a delay remembers: so many, so far apart at least, s.
_KEPT, _APART = 2048, 0.4 * STEP
#: Iterations of a step of the trapezoidal rule: each takes an error of it to a third.
_ITERATIONS = 24
#: Nodes, weights, sum and error of the method of Dormand and Prince, which scipy knows.
_NODES, _WEIGHTS, _SUM, _ERROR = RK45.C, RK45.A, RK45.B, RK45.E


@njit(cache=True)
def _fresh(begin: float, x: np.ndarray) -> np.ndarray:
    return np.array([-inf, begin, x[0], 0.0, 0.0, 0.0])


@njit(cache=True)
def _travelled(law: _Law, x: np.ndarray, time: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """(N, n) states at the samples; none where it leaves.

    pieces (N - 1, 4, 2): cubics of the voltage.
    """
    found = np.empty((len(time), len(x)))
    found[0] = x
    memory = _fresh(time[0], x)
    u = _command(law, time[0], x, pieces[0, 3, 0], pieces[0, 3, 1], memory, np.empty(4))
    commands, newest = np.empty((_KEPT, 3)), 3  # time, d, q of the last ones; at rest before
    for k in range(4):
        commands[k] = time[0] + (k - 3) * STEP, u[0], u[1]
    for n in range(len(time) - 1):
        at, end, step = 0.0, time[n + 1] - time[n], STEP
        while end - at > 1e-9 * STEP:
            h = min(step, STEP, end - at)
            moved, error, u = _step(law, time[n], x, at, h, pieces[n], memory, commands, newest)
            step = h * max(0.2, min(5.0, 0.9 * (error + 1e-30) ** -0.2))
            if error > 1 and h > 1e-9 * STEP:
                continue
            x, at = moved, at + h
            v_D, v_Q = _cubic(pieces[n], at)
            if (hypot(x[2], x[3]) if law.C_F else hypot(v_D, v_Q)) < law.v_block:
                memory[_BELOW] = time[n] + at
            memory[_SINCE], memory[_FROM] = time[n] + at, memory[_RAMPED]
            if time[n] + at - commands[(newest - 1) % _KEPT, 0] > _APART:
                newest += 1
            commands[newest % _KEPT] = time[n] + at, u[0], u[1]
        for state in x[:6]:
            if not abs(state) <= 50:
                return found[:0]
        found[n + 1] = x
    return found


@njit(cache=True)
def _in_fixed_steps(law: _Law, x: np.ndarray, time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N, n) states at the samples, by x + h/2 (f(x) + f(x')), solved by iteration; none where it
    leaves.
    """
    found, memory = np.empty((len(time), len(x))), _fresh(time[0], x)
    found[0] = x
    before, after = np.zeros(len(x)), np.zeros(len(x))
    commands, newest = np.empty((_KEPT, 3)), 3
    u = _command(law, time[0], x, v[0, 0], v[0, 1], memory, np.empty(4))
    for k in range(4):
        commands[k] = time[0] + (k - 3) * (time[1] - time[0]), u[0], u[1]
    _rates(law, x, v[0, 0], v[0, 1], u, memory, before)
    for n in range(len(time) - 1):
        h, moved = time[n + 1] - time[n], x
        for _ in range(_ITERATIONS):
            stands = np.empty(4)
            u = _command(law, time[n + 1], moved, v[n + 1, 0], v[n + 1, 1], memory, stands)
            late = _earlier(commands, newest, time[n + 1] - law.delay) if law.delay else u
            _rates(law, moved, v[n + 1, 0], v[n + 1, 1], late, memory, after)
            for place in range(4):
                if stands[place]:
                    after[9 + place] = 0.0
            moved = x + 0.5 * h * (before + after)
        x = moved
        before[:] = after
        if (hypot(x[2], x[3]) if law.C_F else hypot(v[n + 1, 0], v[n + 1, 1])) < law.v_block:
            memory[_BELOW] = time[n + 1]
        memory[_SINCE], memory[_FROM] = time[n + 1], memory[_RAMPED]
        newest += 1
        commands[newest % _KEPT] = time[n + 1], u[0], u[1]
        for state in x[:6]:
            if not abs(state) <= 50:
                return found[:0]
        found[n + 1] = x
    return found


@njit(cache=True)
def _step(
    law: _Law,
    begin: float,
    x: np.ndarray,
    at: float,
    h: float,
    piece: np.ndarray,
    memory: np.ndarray,
    commands: np.ndarray,
    newest: int,
) -> tuple[np.ndarray, float, np.ndarray]:
    """States a step later, the error over what is allowed, and the command there; the last rates
    are those at its end.
    """
    k, moved, u = np.empty((len(_SUM) + 1, len(x))), x, np.empty(2)
    for stage in range(len(k)):
        last = stage == len(_SUM)
        weights, since = (_SUM, at + h) if last else (_WEIGHTS[stage], at + _NODES[stage] * h)
        moved = x.copy()
        for before in range(stage):
            moved += h * weights[before] * k[before]
        v_D, v_Q = _cubic(piece, since)
        stands = np.empty(4)
        u = _command(law, begin + since, moved, v_D, v_Q, memory, stands)
        late = _earlier(commands, newest, begin + since - law.delay) if law.delay else u
        _rates(law, moved, v_D, v_Q, late, memory, k[stage])
        for place in range(4):
            if stands[place]:
                k[stage, 9 + place] = 0.0
    allowed = ABSOLUTE + RELATIVE * np.maximum(np.abs(x), np.abs(moved))
    return moved, np.sqrt(np.mean((h * (_ERROR @ k) / allowed) ** 2)), u


@njit(cache=True)
def _earlier(commands: np.ndarray, newest: int, time: float) -> np.ndarray:
    """The command at a time, a cubic through the four kept ones around it."""
    low, high = max(newest - _KEPT + 1, 0), newest
    while high - low > 1:
        middle = (low + high) // 2
        if commands[middle % _KEPT, 0] <= time:
            low = middle
        else:
            high = middle
    first = max(min(low - 1, newest - 3), max(newest - _KEPT + 1, 0))
    value = np.zeros(2)
    if time <= commands[first % _KEPT, 0]:
        return commands[first % _KEPT, 1:].copy()
    for k in range(4):
        weight, own = 1.0, commands[(first + k) % _KEPT]
        for other in range(4):
            if other != k:
                there = commands[(first + other) % _KEPT, 0]
                weight *= (time - there) / (own[0] - there)
        value += weight * own[1:]
    return value


@njit(cache=True)
def _cubic(piece: np.ndarray, since: float) -> tuple[float, float]:
    d, q = piece[0]
    for power in range(1, 4):
        d, q = d * since + piece[power, 0], q * since + piece[power, 1]
    return d, q


@njit(cache=True)
def _helped(law: _Law, e: float) -> float:
    return law.k * (max(e - 1 - law.dead, 0.0) - max(1 - law.dead - e, 0.0))


@njit(cache=True)
def _seen(
    law: _Law, x: np.ndarray, v_D: float, v_Q: float
) -> tuple[float, float, float, float, float, float, float]:
    """The PCC's voltage in the frame of the PLL, e and the current into the grid there, and the
    PLL's slip, rad/s.
    """
    i_d, i_q, e_d, e_q, g_d, g_q, delta, phi, filtered = x[:9]
    c, s = cos(delta), sin(delta)
    v_d, v_q = c * v_D + s * v_Q, c * v_Q - s * v_D
    if not law.C_F:
        e_d, e_q, g_d, g_q = v_d, v_q, i_d, i_q
    seen = filtered if law.w_pll else e_q
    if hypot(e_d, e_q) < law.v_freeze:
        seen = 0.0
    return v_d, v_q, e_d, e_q, g_d, g_q, law.kP_pll * seen + law.kI_pll * phi


@njit(cache=True)
def _command(
    law: _Law,
    t: float,
    x: np.ndarray,
    v_D: float,
    v_Q: float,
    memory: np.ndarray,
    stands: np.ndarray,
) -> np.ndarray:
    """(2,) the voltage command, limited, before its delay.

    stands (4,) : which of the integrators of p, q, d and q stand; set.
    """
    _, _, e_d, e_q, g_d, g_q, slip = _seen(law, x, v_D, v_Q)
    i_d, i_q, e = x[0], x[1], hypot(e_d, e_q)
    err_p = law.p - (e_d * g_d + e_q * g_q)
    err_q = law.q - (e_q * g_d - e_d * g_q)
    r_d = law.kP * err_p + law.kI * x[9]
    r_q = -law.kP * err_q + law.kI * x[10] + _helped(law, e) - _helped(law, law.e)
    if law.ramp < inf:
        reach = law.ramp * (t - memory[_SINCE])
        r_d = memory[_FROM] + max(-reach, min(reach, r_d - memory[_FROM]))
        memory[_RAMPED] = r_d
    stand_p = stand_q = stand = False
    if memory[_BELOW] > -inf or e < law.v_block:
        since = 0.0 if e < law.v_block else t - memory[_BELOW]
        most = 0.0 if since < law.t_hold else law.back * (since - law.t_hold)
        b_d, b_q = _scaled(r_d, r_q, most)
        stand_p, stand_q = (r_d - b_d) * err_p > 0, (r_q - b_q) * -err_q > 0
        r_d, r_q = b_d, b_q
    if law.i_max < inf:
        b_d, b_q = _limited(r_d, r_q, law.i_max, law.first)
        if not law.i_windup:
            stand_p, stand_q = (
                stand_p or (r_d - b_d) * err_p > 0,
                stand_q or (r_q - b_q) * -err_q > 0,
            )
        r_d, r_q = b_d, b_q
    decoupling = law.decoupling * (1 + slip / OMEGA)
    fed_d, fed_q = (x[13], x[14]) if law.w_feedforward else (e_d, e_q)
    u_d = law.kP_c * (r_d - i_d) + law.kI_c * x[11] + law.feedforward * fed_d - decoupling * i_q
    u_q = law.kP_c * (r_q - i_q) + law.kI_c * x[12] + law.feedforward * fed_q + decoupling * i_d
    u_d -= law.k_damping * (i_d - g_d)
    u_q -= law.k_damping * (i_q - g_q)
    if hypot(u_d, u_q) > law.u_max:
        u_d, u_q = _scaled(u_d, u_q, law.u_max)
        stand = not law.u_windup
    memory[_R_D], memory[_R_Q] = r_d, r_q
    stands[:] = stand_p, stand_q, stand, stand
    return np.array([u_d, u_q])


@njit(cache=True)
def _rates(
    law: _Law,
    x: np.ndarray,
    v_D: float,
    v_Q: float,
    u: np.ndarray,
    memory: np.ndarray,
    out: np.ndarray,
) -> None:
    """Rates of the states, where `memory` has the reference of the current; no integrator stands.

    u (2,) : as it acts.
    """
    v_d, v_q, e_d, e_q, g_d, g_q, slip = _seen(law, x, v_D, v_Q)
    i_d, i_q, w = x[0], x[1], OMEGA + slip
    seen = (slip - law.kI_pll * x[7]) / law.kP_pll
    out[0] = OMEGA / law.L_F * (u[0] - e_d - law.R_F * i_d) + w * i_q
    out[1] = OMEGA / law.L_F * (u[1] - e_q - law.R_F * i_q) - w * i_d
    out[2:6] = 0.0
    if law.C_F:
        out[2] = OMEGA / law.C_F * (i_d - g_d) + w * e_q
        out[3] = OMEGA / law.C_F * (i_q - g_q) - w * e_d
        out[4] = OMEGA / law.L_g * (e_d - v_d - law.R_g * g_d) + w * g_q
        out[5] = OMEGA / law.L_g * (e_q - v_q - law.R_g * g_q) - w * g_d
    out[6], out[7], out[8] = slip, seen, law.w_pll * (e_q - x[8])
    out[9], out[10] = law.p - (e_d * g_d + e_q * g_q), (e_q * g_d - e_d * g_q) - law.q
    out[11], out[12] = memory[_R_D] - i_d, memory[_R_Q] - i_q
    out[13], out[14] = law.w_feedforward * (e_d - x[13]), law.w_feedforward * (e_q - x[14])


@njit(cache=True)
def _scaled(a: float, b: float, most: float) -> tuple[float, float]:
    size = hypot(a, b)
    if size <= most:
        return a, b
    return a * most / size, b * most / size


@njit(cache=True)
def _limited(d: float, q: float, most: float, first: float) -> tuple[float, float]:
    """first : 0 both alike, 1 d, 2 q."""
    if first == 0:
        return _scaled(d, q, most)
    one, other = (d, q) if first == 1 else (q, d)
    one = max(-most, min(most, one))
    room = max(most * most - one * one, 0.0) ** 0.5
    other = max(-room, min(room, other))
    return (one, other) if first == 1 else (other, one)
