"""A grid-following inverter with limits, written from the laws alone: plain numbers, scipy's adaptive Runge-Kutta method.

Nothing is shared with the package: LCL or L filter in the PLL's frame, power loops, current control, and around it voltage
support, reference ramp, momentary cessation, current limit and command limit as the contract of the events says. Frame: e on d.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import cos, hypot, sin
from typing import Any

import numpy as np
from scipy.integrate import RK45
from scipy.interpolate import CubicSpline

OMEGA = 120 * np.pi
#: Largest step, s, and with a ramp: kinks and jumps of the laws are met by short steps.
STEP, RAMPED = 1e-5, 3e-6
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
    spline, memory = CubicSpline(time, v), {"below": -np.inf, "since": time[0], "from": x[0]}
    rates = _rates(device, wanted, spline, memory)
    most = RAMPED if "reference_ramp" in device.limits else STEP
    found = np.empty((len(time), 2))
    state = np.array(x)
    for k, t in enumerate(time):
        found[k] = _out(device, state)
        if k == len(time) - 1:
            break
        solver = RK45(rates, t, state, time[k + 1], max_step=most, rtol=1e-8, atol=1e-10)
        while solver.status == "running":
            solver.step()
            size = hypot(*(solver.y[2:4] if device.numbers["C_F"] else spline(solver.t)))
            if "momentary_cessation" in device.limits and size < device.limits["momentary_cessation"]["v_block"]:
                memory["below"] = solver.t
            memory |= {
                "since": solver.t,
                "from": memory.get("ramped", 0.0),
            }  # the last rates are those where a step ends
        state = solver.y
        if not np.isfinite(state).all() or np.abs(state[:6]).max() > 50:
            raise ValueError("it leaves")
    return found


def linear(device: Device, point: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of the device at rest from the voltage to the current at the PCC, by differences; no limit acts there."""
    x, wanted = at_rest(Device(device.numbers), *point)
    lacks = [name for name, number in (("filtered", "w_pll"), ("e_d", "C_F"), ("e_q", "C_F"), ("g_d", "C_F"), ("g_q", "C_F"))
             if not device.numbers[number]]  # fmt: skip
    keep = [k for k, name in enumerate(STATES) if name not in lacks]
    x, step = np.array(x), 1e-6

    def rates(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return _rates(Device(device.numbers), wanted, lambda t: v, {"below": -np.inf})(0.0, x)

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


def _rates(
    device: Device, wanted: Mapping[str, float], voltage: Any, memory: dict[str, float]
) -> Callable[..., np.ndarray]:
    n, limits = device.numbers, device.limits
    freeze, support = limits.get("pll_freeze"), limits.get("voltage_support")
    ramp, cease = limits.get("reference_ramp"), limits.get("momentary_cessation")
    limit, command = limits.get("current_limit"), limits.get("command_limit")

    def helped(e: float) -> float:
        if support is None:
            return 0.0
        low, high = 1 - support["dead"] - e, e - 1 - support["dead"]
        return support["k"] * (max(high, 0.0) - max(low, 0.0))

    at_rest_help = helped(wanted["e"])

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        i_d, i_q, e_d, e_q, g_d, g_q, delta, phi, filtered, x_p, x_q, y_d, y_q = x.tolist()
        v_D, v_Q = (float(one) for one in voltage(t))
        c, s = cos(delta), sin(delta)
        v_d, v_q = c * v_D + s * v_Q, c * v_Q - s * v_D
        if not n["C_F"]:
            e_d, e_q, g_d, g_q = v_d, v_q, i_d, i_q
        e = hypot(e_d, e_q)
        seen = filtered if n["w_pll"] else e_q
        if freeze is not None and e < freeze["v_freeze"]:
            seen = 0.0
        slip = n["kP_pll"] * seen + n["kI_pll"] * phi
        speed = 1 + slip / OMEGA
        err_p = wanted["p"] - (e_d * g_d + e_q * g_q)
        err_q = wanted["q"] - (e_q * g_d - e_d * g_q)
        r_d = n["kP"] * err_p + n["kI"] * x_p
        r_q = -n["kP"] * err_q + n["kI"] * x_q + helped(e) - at_rest_help
        if ramp is not None:
            reach = ramp["ramp"] * (t - memory["since"])
            r_d = memory["ramped"] = memory["from"] + max(-reach, min(reach, r_d - memory["from"]))
        stand_p = stand_q = False
        if cease is not None and (memory["below"] > -np.inf or e < cease["v_block"]):
            since = 0.0 if e < cease["v_block"] else t - memory["below"]
            most = 0.0 if since < cease["t_hold"] else cease["ramp"] * (since - cease["t_hold"])
            b_d, b_q = _scaled(r_d, r_q, most)
            stand_p, stand_q = (r_d - b_d) * err_p > 0, (r_q - b_q) * -err_q > 0
            r_d, r_q = b_d, b_q
        if limit is not None:
            b_d, b_q = _limited(r_d, r_q, limit["i_max"], limit["mode"])
            if not limit["windup"]:
                stand_p, stand_q = stand_p or (r_d - b_d) * err_p > 0, stand_q or (r_q - b_q) * -err_q > 0
            r_d, r_q = b_d, b_q
        k_d, k_q = r_d - i_d, r_q - i_q
        decoupling = n["decoupling"] * speed
        u_d = n["kP_c"] * k_d + n["kI_c"] * y_d + n["feedforward"] * e_d - decoupling * i_q
        u_q = n["kP_c"] * k_q + n["kI_c"] * y_q + n["feedforward"] * e_q + decoupling * i_d
        stand = False
        if command is not None and hypot(u_d, u_q) > command["u_max"]:
            u_d, u_q = _scaled(u_d, u_q, command["u_max"])
            stand = not command["windup"]
        w = OMEGA + slip
        middle = [
            OMEGA / n["C_F"] * (i_d - g_d) + w * e_q,
            OMEGA / n["C_F"] * (i_q - g_q) - w * e_d,
            OMEGA / n["L_g"] * (e_d - v_d - n["R_g"] * g_d) + w * g_q,
            OMEGA / n["L_g"] * (e_q - v_q - n["R_g"] * g_q) - w * g_d,
        ] if n["C_F"] else [0.0] * 4  # fmt: skip
        return np.array([
            OMEGA / n["L_F"] * (u_d - e_d - n["R_F"] * i_d) + w * i_q,
            OMEGA / n["L_F"] * (u_q - e_q - n["R_F"] * i_q) - w * i_d,
            *middle,
            slip, seen, n["w_pll"] * (e_q - filtered),
            0.0 if stand_p else err_p, 0.0 if stand_q else -err_q,
            0.0 if stand else k_d, 0.0 if stand else k_q,
        ])  # fmt: skip

    return rates


def _scaled(a: float, b: float, most: float) -> tuple[float, float]:
    size = hypot(a, b)
    return (a, b) if size <= most else (a * most / size, b * most / size)


def _limited(d: float, q: float, most: float, mode: str) -> tuple[float, float]:
    if mode == "magnitude":
        return _scaled(d, q, most)
    first, second = (d, q) if mode == "d" else (q, d)
    first = max(-most, min(most, first))
    room = max(most * most - first * first, 0.0) ** 0.5
    second = max(-room, min(room, second))
    return (first, second) if mode == "d" else (second, first)
