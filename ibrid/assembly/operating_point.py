"""The operating point of the plant, in closed form from p, q, v and the plant's parameters alone.

Works on floats and CasADi symbols alike. Vectors are pairs (D, Q) in the grid frame, v = (v, 0).
Where no real operating point exists the square root is of a negative number and the result is not a
number.
"""

from collections.abc import Mapping
from typing import Any

from ibrid.assembly.numbers import is_zero
from ibrid.errors import DiagramError
from ibrid.modules.kind import ModuleKind
from ibrid.modules.large_signal import square_root
from ibrid.modules.own_law import call_law
from ibrid.modules.vocabulary import VOCABULARY

Pair = tuple[Any, Any]
Parameters = Mapping[str, Any]


def add(first: Pair, second: Pair) -> Pair:
    """Sum of two vectors."""
    return first[0] + second[0], first[1] + second[1]


def series_drop(resistance: Any, reactance: Any, i: Pair) -> Pair:
    """(R + L J) i."""
    return resistance * i[0] - reactance * i[1], resistance * i[1] + reactance * i[0]


def plant_equilibrium(
    kind: ModuleKind, parameters: Parameters, p: Any, q: Any, v: Any, power_node: str
) -> dict[str, Pair]:
    """Equilibrium of the plant's ports in the grid frame.

    With power measured at e behind R_g, L_g: E^2 is the larger root of E^4 - (v^2 + 2a) E^2 + c = 0
    with a = R_g p + L_g q, c = (R_g^2 + L_g^2)(p^2 + q^2); i_g = (p/E, -q/E) in the frame of e.
    With power measured at the terminals i_g = (p/v, -q/v) in the grid frame; an L filter's e is
    there. Always i_ti = i_g + the current of the capacitor branches at e, u_r = e + (R_F + L_F J)
    i_ti, L_F at that current where it depends on it.

    Parameters
    ----------
    kind : a plant that declares its `branches` or `plant_at_rest`. parameters : of the plant, per
    unit. p, q, v : per unit, delivered, q = e' J i.
    power_node : "capacitor" or "pcc", where p and q of the plant are measured; what branches draw
    beside it is not in them.

    Raises DiagramError for another plant, whose operating point is not known in closed form.
    """
    if kind.plant_at_rest is not None:
        return dict(
            call_law(
                kind.name, kind.plant_at_rest, **parameters, p=p, q=q, v=v, power_node=power_node
            )
        )
    if kind.branches is None:
        *first, last = (one.name for one in VOCABULARY if one.branches is not None)
        raise DiagramError(
            f"the operating point is known for {', '.join(first)} or {last}, found {kind.name}; "
            "use one of these, declare its "
            'branches or plant_at_rest, or take equilibrium="paper", where it is fitted'
        )
    v_in = (v, 0.0)
    i_g = (p / v, -q / v)  # of power at the terminals
    if not kind.has_line:
        e = v_in
    elif power_node == "pcc":
        e = add(v_in, series_drop(parameters["R_g"], parameters["L_g"], i_g))
    else:
        e, i_g = _behind_line(parameters["R_g"], parameters["L_g"], p, q, v)
    i_c: Pair = (0.0, 0.0)
    for resistance, capacitance, *inductance in kind.branches:
        r, c, *l_branch = (
            parameters[name] if name else 0.0 for name in (resistance, capacitance, *inductance)
        )
        i_c = add(
            i_c, _trap_current(r, c, l_branch[0], e) if l_branch else _branch_current(r, c, e)
        )
    i_ti = add(i_g, i_c)
    if kind.reactance_at_rest is None:
        reactance = parameters["L_F"]
    else:
        reactance = call_law(kind.name, kind.reactance_at_rest, i_ti, **parameters)
    u_r = add(e, series_drop(parameters["R_F"], reactance, i_ti))
    return {"v_in": v_in, "e": e, "i_g": i_g, "i_ti": i_ti, "i_C": i_c, "u_r": u_r}


def _branch_current(resistance: Any, capacitance: Any, e: Pair) -> Pair:
    """Current of a series R, C: C (R C I + J) e / (1 + (R C)^2)."""
    x = resistance * capacitance
    scale = capacitance / (1 + x * x)
    return scale * (x * e[0] - e[1]), scale * (x * e[1] + e[0])


def _trap_current(resistance: Any, capacitance: Any, inductance: Any, e: Pair) -> Pair:
    """Current of a series R, C, L: (R I - X J) e / (R^2 + X^2), X = L - 1/C; C of zero stands for
    no capacitor.
    """
    x = inductance - (0.0 if is_zero(capacitance) else 1 / capacitance)
    square = resistance * resistance + x * x
    return (resistance * e[0] + x * e[1]) / square, (resistance * e[1] - x * e[0]) / square


def _behind_line(r_g: Any, l_g: Any, p: Any, q: Any, v: Any) -> tuple[Pair, Pair]:
    """Voltage and current at a node that delivers p and q through r_g, l_g to the terminal voltage
    (v, 0).
    """
    b = v * v + 2 * (r_g * p + l_g * q)
    c = (r_g * r_g + l_g * l_g) * (p * p + q * q)
    magnitude = square_root((b + square_root(b * b - 4 * c)) / 2)
    i_e = (p / magnitude, -q / magnitude)
    drop = series_drop(r_g, l_g, i_e)
    cosine, sine = (magnitude - drop[0]) / v, drop[1] / v  # of atan2(-v_q, v_d) in the frame of e
    e = (cosine * magnitude, sine * magnitude)
    return e, (cosine * i_e[0] - sine * i_e[1], sine * i_e[0] + cosine * i_e[1])
