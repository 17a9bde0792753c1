"""A grid-following inverter with limits, written from the laws alone: plain numbers, short steps of a Runge-Kutta method.

Nothing is shared with the package: LCL or L filter in the PLL's frame, power loops, current control, and around it voltage
support, reference ramp, momentary cessation, current limit and command limit as the contract of the events says. Frame: e on d.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import cos, hypot, inf, sin
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import RK45
from scipy.interpolate import CubicSpline

OMEGA = 120 * np.pi
#: Largest step, s: kinks of the laws are met by short steps, jumps by the control of the error.
STEP = 2.5e-6
#: Relative and absolute error of a step, per unit.
RELATIVE, ABSOLUTE = 1e-8, 1e-10
#: Names of states.
STATES = ("i_d", "i_q", "e_d", "e_q", "g_d", "g_q", "delta", "phi", "filtered", "x_p", "x_q", "y_d", "y_q")


@dataclass(frozen=True)
class Device:
    """`numbers` : L_F R_F C_F L_g R_g kP_pll kI_pll w_pll (0: none) kP kI kP_c kI_c feedforward decoupling, per unit, 1/s, rad/s.
    C_F = 0 : an L filter, L_F and R_F alone between the inverter and the PCC, whose voltage is seen.

    `limits` : id -> its parameters, "mode" and "windup" among them.
    """

    numbers: Mapping[str, float]
    limits: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def at_rest(device: Device, p: float, q: float, v: float) -> tuple[list[float], dict[str, float]]:
    """States at rest with p, q delivered at the capacitor, and the set-points; ValueError where there is no such point."""
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
    own = n["feedforward"] * e + 1j * n["decoupling"] * i  # what the current controller need not give
    y = u - own
    return [
        i.real, i.imag, e, 0.0, g.real, g.imag, float(-np.angle(grid)), 0.0, 0.0, i.real / n["kI"], i.imag / n["kI"],
        y.real / n["kI_c"], y.imag / n["kI_c"],
    ], {"p": p, "q": q, "e": e}  # fmt: skip


def simulate(device: Device, point: tuple[float, float, float], time: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N, 2) current into the grid at the samples; v (N, 2) at the PCC, a cubic spline between. ValueError where it leaves."""
    x, wanted = at_rest(device, *point)
    pieces = np.ascontiguousarray(np.moveaxis(CubicSpline(time, v).c, 0, 1))
    states = _travelled(_law(device, wanted), np.array(x), np.asarray(time, float), pieces)
    if not len(states):
        raise ValueError("it leaves")
    return np.array([_out(device, state) for state in states])


def linear(device: Device, point: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of the device at rest from the voltage to the current at the PCC, by differences; no limit acts there."""
    x, wanted = at_rest(Device(device.numbers), *point)
    lacks = [name for name, number in (("filtered", "w_pll"), ("e_d", "C_F"), ("e_q", "C_F"), ("g_d", "C_F"), ("g_q", "C_F"))
             if not device.numbers[number]]  # fmt: skip
    keep = [k for k, name in enumerate(STATES) if name not in lacks]
    x, step = np.array(x), 1e-6
    law = _law(Device(device.numbers), wanted)

    def rates(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = np.empty(len(x))
        _rates(law, 0.0, x, v[0], v[1], np.array([-inf, 0.0, 0.0, 0.0]), out)
        return out

    def slopes(answer: Callable[[np.ndarray], Any], size: int) -> np.ndarray:
        moves = step * np.eye(size)
        return np.array([np.subtract(answer(one), answer(-one)) for one in moves]).T / (2 * step)

    v = np.array([point[2], 0.0])
    a = slopes(lambda move: rates(x + move, v), 13)
    b = slopes(lambda move: rates(x, v + move), 2)
    c = slopes(lambda move: _out(device, x + move), 13)
    return a[np.ix_(keep, keep)], b[keep], c[:, keep]


def poles(device: Device, point: tuple[float, float, float]) -> np.ndarray:
    """Of the device at rest, 1/s."""
    return np.linalg.eigvals(linear(device, point)[0])


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
        "k": support.get("k", 0.0), "dead": support.get("dead", 0.0),
        "ramp": limits.get("reference_ramp", {}).get("ramp", inf),
        "v_block": cease.get("v_block", 0.0), "t_hold": cease.get("t_hold", 0.0), "back": cease.get("ramp", 0.0),
        "i_max": limit.get("i_max", inf), "first": ("magnitude", "d", "q").index(limit.get("mode", "magnitude")),
        "i_windup": limit.get("windup", False), "u_max": command.get("u_max", inf), "u_windup": command.get("windup", False),
    }  # fmt: skip
    every = {**device.numbers, **wanted, **law}
    return _Law(*(float(every[name]) for name in _Law._fields))


#: Where a device remembers: when its voltage was last below v_block, and when and where the ramp began its last step.
_BELOW, _SINCE, _FROM, _RAMPED = range(4)
#: Nodes, weights, sum and error of the method of Dormand and Prince, which scipy knows.
_NODES, _WEIGHTS, _SUM, _ERROR = RK45.C, RK45.A, RK45.B, RK45.E


@njit(cache=True)
def _travelled(law: _Law, x: np.ndarray, time: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """(N, 13) states at the samples; none where it leaves. pieces (N - 1, 4, 2): cubics of the voltage."""
    found = np.empty((len(time), len(x)))
    found[0] = x
    memory = np.array([-inf, time[0], x[0], 0.0])
    for n in range(len(time) - 1):
        at, end, step = 0.0, time[n + 1] - time[n], STEP
        while end - at > 1e-9 * STEP:
            h = min(step, STEP, end - at)
            moved, error = _step(law, time[n], x, at, h, pieces[n], memory)
            step = h * max(0.2, min(5.0, 0.9 * (error + 1e-30) ** -0.2))
            if error > 1 and h > 1e-9 * STEP:
                continue
            x, at = moved, at + h
            v_D, v_Q = _cubic(pieces[n], at)
            if (hypot(x[2], x[3]) if law.C_F else hypot(v_D, v_Q)) < law.v_block:
                memory[_BELOW] = time[n] + at
            memory[_SINCE], memory[_FROM] = time[n] + at, memory[_RAMPED]
        for state in x[:6]:
            if not abs(state) <= 50:
                return found[:0]
        found[n + 1] = x
    return found


@njit(cache=True)
def _step(
    law: _Law, begin: float, x: np.ndarray, at: float, h: float, piece: np.ndarray, memory: np.ndarray
) -> tuple[np.ndarray, float]:
    """States a step later, and the error over what is allowed; the last rates are those where the step ends."""
    k, moved = np.empty((len(_SUM) + 1, len(x))), x
    for stage in range(len(k)):
        last = stage == len(_SUM)
        weights, since = (_SUM, at + h) if last else (_WEIGHTS[stage], at + _NODES[stage] * h)
        moved = x.copy()
        for before in range(stage):
            moved += h * weights[before] * k[before]
        v_D, v_Q = _cubic(piece, since)
        _rates(law, begin + since, moved, v_D, v_Q, memory, k[stage])
    allowed = ABSOLUTE + RELATIVE * np.maximum(np.abs(x), np.abs(moved))
    return moved, np.sqrt(np.mean((h * (_ERROR @ k) / allowed) ** 2))


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
def _rates(law: _Law, t: float, x: np.ndarray, v_D: float, v_Q: float, memory: np.ndarray, out: np.ndarray) -> None:
    i_d, i_q, e_d, e_q, g_d, g_q, delta, phi, filtered, x_p, x_q, y_d, y_q = x
    c, s = cos(delta), sin(delta)
    v_d, v_q = c * v_D + s * v_Q, c * v_Q - s * v_D
    if not law.C_F:
        e_d, e_q, g_d, g_q = v_d, v_q, i_d, i_q
    e = hypot(e_d, e_q)
    seen = filtered if law.w_pll else e_q
    if e < law.v_freeze:
        seen = 0.0
    slip = law.kP_pll * seen + law.kI_pll * phi
    speed = 1 + slip / OMEGA
    err_p = law.p - (e_d * g_d + e_q * g_q)
    err_q = law.q - (e_q * g_d - e_d * g_q)
    r_d = law.kP * err_p + law.kI * x_p
    r_q = -law.kP * err_q + law.kI * x_q + _helped(law, e) - _helped(law, law.e)
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
            stand_p, stand_q = stand_p or (r_d - b_d) * err_p > 0, stand_q or (r_q - b_q) * -err_q > 0
        r_d, r_q = b_d, b_q
    k_d, k_q = r_d - i_d, r_q - i_q
    decoupling = law.decoupling * speed
    u_d = law.kP_c * k_d + law.kI_c * y_d + law.feedforward * e_d - decoupling * i_q
    u_q = law.kP_c * k_q + law.kI_c * y_q + law.feedforward * e_q + decoupling * i_d
    if hypot(u_d, u_q) > law.u_max:
        u_d, u_q = _scaled(u_d, u_q, law.u_max)
        stand = not law.u_windup
    w = OMEGA + slip
    out[0] = OMEGA / law.L_F * (u_d - e_d - law.R_F * i_d) + w * i_q
    out[1] = OMEGA / law.L_F * (u_q - e_q - law.R_F * i_q) - w * i_d
    out[2:6] = 0.0
    if law.C_F:
        out[2] = OMEGA / law.C_F * (i_d - g_d) + w * e_q
        out[3] = OMEGA / law.C_F * (i_q - g_q) - w * e_d
        out[4] = OMEGA / law.L_g * (e_d - v_d - law.R_g * g_d) + w * g_q
        out[5] = OMEGA / law.L_g * (e_q - v_q - law.R_g * g_q) - w * g_d
    out[6], out[7], out[8] = slip, seen, law.w_pll * (e_q - filtered)
    out[9], out[10] = 0.0 if stand_p else err_p, 0.0 if stand_q else -err_q
    out[11], out[12] = 0.0 if stand else k_d, 0.0 if stand else k_q


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
