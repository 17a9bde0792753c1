"""A port in front of an averaged model: the elements' laws with those of the device, from its
terminals outwards.

Per unit, in the device's frame, whose speed is omega = omega_0 + deviation: series v_in = v + R i +
L/omega_0 i' + (omega/omega_0) L J i; shunt v = v_c + R i_s, C/omega_0 v_c' = i_s - (omega/omega_0)
C J v_c, i = i_in - i_s; a transformer has its R and L on the side of the PCC, then v_in = v /
ratio. What lies at the PCC itself is driven by the measured voltage alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ibrid.assembly.rest import Rest
from ibrid.assembly.signals_at_rest import to_frame
from ibrid.assembly.terminals import Parameters, inwards, resistance_of
from ibrid.errors import IbridError
from ibrid.measurement.recordings.dq_pairs import to_complex, to_pairs
from ibrid.structure.network.outside import ELEMENTS, PORT, Outside

#: Element number, its kind and the names of its numbers.
_Element = tuple[int, str, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Through:
    """Laws seen from the PCC.

    `results` : those given, rates first, in terms of `v`, the voltage at the PCC. `states` :
    further symbols, of `own`, (element, kind) each with two. `constants` : symbols of what
    `port_constants` gives.
    """

    results: list[ca.SX]
    v: ca.SX
    states: ca.SX
    own: tuple[tuple[int, str], ...]
    constants: ca.SX


def elements_of(outside: Outside) -> tuple[list[_Element], list[_Element]]:
    """The shunts at the PCC itself, and the elements behind them, from the PCC inwards."""
    every = [(k, one.kind, ELEMENTS[one.kind]) for k, one in enumerate(outside.elements, start=1)]
    first = list(takewhile(lambda one: one[1] == "shunt", every))
    return first, every[len(first) :]


def through_port(
    outside: Outside, results: Sequence[ca.SX], x: ca.SX, v: ca.SX, omega_0: float
) -> Through:
    """Put elements before a device; results : its rates and its terminal current, then what else
    depends on x and v (2,).
    """
    laws, states, own = list(results), [x], []
    turn, deviation = ca.SX.sym("turn", 2), ca.SX.sym("deviation")
    constants = [turn, deviation]
    omega = omega_0 + deviation
    for k, kind, names in reversed(elements_of(outside)[1]):
        number = {name: ca.SX.sym(f"{PORT}.{k}.{name}") for name in names}
        constants += number.values()
        if kind == "transformer":
            behind, v = v, ca.SX.sym("v", 2)
            laws = [ca.substitute(one, behind, v / number["ratio"]) for one in laws]
            laws[1] = laws[1] / number["ratio"]
        i, added = laws[1], ca.SX.sym(f"{kind}.{k}", 2)
        if kind == "shunt":
            drawn = (v - added) / number["R"]
            laws[0] = ca.vertcat(laws[0], omega_0 / number["C"] * drawn - omega * _turned(added))
            laws[1] = i - drawn
        else:
            behind, v = v, ca.SX.sym("v", 2)
            r, rate = number["R"], omega_0 / number["L"]
            if ca.depends_on(i, behind):
                v_in = solved(i - added, behind, v)
                laws[0] = ca.vertcat(
                    laws[0], rate * (behind - v - r * added) - omega * _turned(added)
                )
                laws[1] = added
            else:
                slope = ca.jacobian(i, ca.vertcat(*states)) @ laws[0]
                v_in = solved(behind - v - r * i - (slope + omega * _turned(i)) / rate, behind, v)
                added = ca.SX(0, 1)
            laws = [ca.substitute(one, behind, v_in) for one in laws]
        if added.numel():
            states.append(added)
            own.append((k, kind))
    c, s = turn[0], turn[1]
    at_pcc = ca.SX.sym("v", 2)
    laws = [
        ca.substitute(
            one, v, ca.vertcat(c * at_pcc[0] + s * at_pcc[1], c * at_pcc[1] - s * at_pcc[0])
        )
        for one in laws
    ]
    i = laws[1]
    laws[1] = ca.vertcat(c * i[0] - s * i[1], s * i[0] + c * i[1])
    return Through(laws, at_pcc, ca.vertcat(*states[1:]), tuple(own), ca.vertcat(*constants))


def port_at_rest(
    through: Through, outside: Outside, at: Rest, v: Any, omega_0: float
) -> tuple[list, list]:
    """The states and the constants; v : magnitude of the voltage at the PCC."""
    if at.inner is None or at.inner.current is None:
        raise IbridError("the rest of a diagram without a port was asked for behind one")
    ratio, z, i, rests = 1 + at.deviation / omega_0, (v, 0.0), at.inner.current, {}
    for k, element in enumerate(outside.elements, start=1):
        values = _numbers(at.port, k)
        there = {name: value * (ratio if name in "LC" else 1.0) for name, value in values.items()}
        rests[k] = i
        if element.kind == "shunt":  # v / (1 + j R C)
            x = there["R"] * there["C"]
            rests[k] = (z[0] + x * z[1]) / (1 + x * x), (z[1] - x * z[0]) / (1 + x * x)
        z, i = inwards(element.kind, there, z, i)
    states = [part for k, _ in through.own for part in to_frame(at.inner.turn, rests[k])]
    constants = [*at.inner.turn, at.deviation]
    for k, _, names in reversed(elements_of(outside)[1]):
        constants += [_numbers(at.port, k)[name] for name in names]
    return states, constants


def drawn_at_pcc(
    port: Parameters, outside: Outside, voltage: CubicSpline, omega_0: float, omega: float
) -> np.ndarray:
    """(N, 2) current into the shunts at the PCC at the samples; port : element -> name -> value.
    omega : of the frame, rad/s.

    v_c' = a v - (a + j omega) v_c with a = omega_0 / (R C) has, while v is a cubic, the solution p
    + (v_c - p) exp(-(a + j omega) t) with the cubic p = a sum (-1)^k v^(k) / (a + j omega)^(k + 1):
    exact whatever R is.
    """
    whole = np.zeros(len(voltage.x), dtype=complex)
    v, slope, curve = (to_complex(voltage(voltage.x, order)) for order in range(3))
    third = to_complex(6 * voltage.c[0])
    for k, _, _ in elements_of(outside)[0]:
        values = _numbers(port, k)
        a = omega_0 / (values["R"] * values["C"])
        rate = a + 1j * omega
        smooth = a * (v / rate - slope / rate**2 + curve / rate**3)
        begin, end = smooth[:-1] - a * third / rate**4, smooth[1:] - a * third / rate**4
        decay, v_c = np.exp(-rate * np.diff(voltage.x)), np.full(len(v), a * v[0] / rate)
        for n in range(len(decay)):
            v_c[n + 1] = end[n] + (v_c[n] - begin[n]) * decay[n]
        whole += (v - v_c) / values["R"]
    return to_pairs(whole)


def solved(residual: ca.SX, unknown: ca.SX, start: Any = None) -> ca.SX:
    """The unknown that makes a residual zero by Newton's method: exact after one step where it
    enters linearly.
    """
    root: Any = ca.SX.zeros(unknown.numel()) if start is None else start
    slope = ca.jacobian(residual, unknown)
    for _ in range(3 if ca.depends_on(slope, unknown) else 1):
        at = [ca.substitute(one, unknown, root) for one in (slope, residual)]
        root = root - ca.solve(*at)
    return root


def _numbers(port: Parameters, k: int) -> Mapping[str, Any]:
    values = dict(port[f"{PORT}.{k}"])
    return values | ({"R": resistance_of(values)} if "C" in values else {})


def _turned(z: ca.SX) -> ca.SX:
    """J z."""
    return ca.vertcat(-z[1], z[0])


def require_port_alone(outside: Outside) -> None:
    """IbridError for doubted labels, which records do not have."""
    if outside.labels or outside.known:
        raise IbridError(
            "records of events are played with labels as they are; fit with --labels exact, or "
            "correct the file"
        )
