"""The operating point of the plant, in closed form from p, q, v and the plant's parameters alone.

Works on floats and CasADi symbols alike. Vectors are pairs (D, Q) in the grid frame, v = (v, 0). Where no real operating
point exists the square root is of a negative number and the result is not a number.
"""

from collections.abc import Mapping
from typing import Any

from ibrid.assembly.numbers import square_root
from ibrid.errors import DiagramError

Pair = tuple[Any, Any]


def add(first: Pair, second: Pair) -> Pair:
    """Sum of two vectors."""
    return first[0] + second[0], first[1] + second[1]


def series_drop(resistance: Any, reactance: Any, i: Pair) -> Pair:
    """(R + L J) i."""
    return resistance * i[0] - reactance * i[1], resistance * i[1] + reactance * i[0]


def plant_equilibrium(
    kind: str, parameters: Mapping[str, Any], p: Any, q: Any, v: Any, power_node: str
) -> dict[str, Pair]:
    """Equilibrium of the plant's ports in the grid frame.

    LCL with power measured at the capacitor: E^2 is the larger root of E^4 - (v^2 + 2a) E^2 + c = 0 with
    a = R_g p + L_g q, c = (R_g^2 + L_g^2)(p^2 + q^2); i_g = (p/E, -q/E) in the frame of e. With power measured at the
    terminals i_g = (p/v, -q/v) in the grid frame. Always i_ti = i_g + C_F J e, u_r = e + (R_F + L_F J) i_ti.

    Parameters
    ----------
    kind : "LCL" or "LFilter". parameters : of the plant, per unit. p, q, v : per unit, delivered, q = e' J i.
    power_node : "capacitor" or "pcc", where p and q are measured; the same for an L filter.

    Raises DiagramError for another plant, whose operating point is not known in closed form.
    """
    if kind not in ("LCL", "LFilter"):
        raise DiagramError(
            f"the operating point is known for an LCL or an LFilter, found {kind}; use one of these, "
            'or equilibrium="paper", where it is fitted'
        )
    v_in = (v, 0.0)
    i_terminal = (p / v, -q / v)
    if kind == "LFilter":
        u_r = add(v_in, series_drop(parameters["R_F"], parameters["L_F"], i_terminal))
        return {"v_in": v_in, "e": v_in, "i_g": i_terminal, "i_ti": i_terminal, "u_r": u_r}
    r_g, l_g = parameters["R_g"], parameters["L_g"]
    if power_node == "pcc":
        i_g = i_terminal
        e = add(v_in, series_drop(r_g, l_g, i_g))
    else:
        b = v * v + 2 * (r_g * p + l_g * q)
        c = (r_g * r_g + l_g * l_g) * (p * p + q * q)
        magnitude = square_root((b + square_root(b * b - 4 * c)) / 2)
        i_e = (p / magnitude, -q / magnitude)
        drop = series_drop(r_g, l_g, i_e)
        cosine, sine = (magnitude - drop[0]) / v, drop[1] / v  # of atan2(-v_q, v_d) in the frame of e
        e = (cosine * magnitude, sine * magnitude)
        i_g = (cosine * i_e[0] - sine * i_e[1], sine * i_e[0] + cosine * i_e[1])
    c_f = parameters["C_F"]
    i_c = (-c_f * e[1], c_f * e[0])
    i_ti = add(i_g, i_c)
    u_r = add(e, series_drop(parameters["R_F"], parameters["L_F"], i_ti))
    return {"v_in": v_in, "e": e, "i_g": i_g, "i_ti": i_ti, "i_C": i_c, "u_r": u_r}
