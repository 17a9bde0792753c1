"""The output filter between converter and grid: LCL or L, in the controller frame that turns at
omega_0 + domega.

Per unit: x' / omega_0 = ...; the third input is the frequency deviation of the frame in rad/s, and
its column is -J x_eq because the term -omega J x of equation (1) is linearised about x_eq.
"""

from collections.abc import Sequence
from typing import Any

from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.large_signal import LargeSignal
from ibrid.signals import Signal

INDUCTANCE = Range(1e-4, 1.0, 0.1, "pu", "inductance", divides=True)
RESISTANCE = Range(1e-5, 1.0, 5e-3, "pu", "resistance")
CAPACITANCE = Range(1e-5, 1.0, 0.05, "pu", "filter capacitance", divides=True)


def lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, e_eq, i_g_eq):
    """(A, B, C, D) of the LCL filter."""
    w, f, c, g = omega_0, omega_0 / L_F, omega_0 / C_F, omega_0 / L_g
    a = [
        [-f * R_F, w, -f, 0, 0, 0],
        [-w, -f * R_F, 0, -f, 0, 0],
        [c, 0, 0, w, -c, 0],
        [0, c, -w, 0, 0, -c],
        [0, 0, g, 0, -g * R_g, w],
        [0, 0, 0, g, -w, -g * R_g],
    ]
    b = [
        [f, 0, 0, 0, i_ti_eq[1]],
        [0, f, 0, 0, -i_ti_eq[0]],
        [0, 0, 0, 0, e_eq[1]],
        [0, 0, 0, 0, -e_eq[0]],
        [0, 0, -g, 0, i_g_eq[1]],
        [0, 0, 0, -g, -i_g_eq[0]],
    ]
    i_ti = [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]]
    e = [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]]
    i_g = [[0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]
    i_c = [[1, 0, 0, 0, -1, 0], [0, 1, 0, 0, 0, -1]]
    return a, b, [*i_ti, *e, *i_g, e[1], *i_c], [[0] * 5 for _ in range(9)]


def series_rate(before: Any, behind: Any, i: Any, R: Any, rate: Any, omega: Any) -> Sequence[Any]:
    """i' = rate (before - behind - R i) - omega J i, a winding or, with currents for voltages, a
    capacitor.
    """
    return (
        rate * (before[0] - behind[0] - R * i[0]) + omega * i[1],
        rate * (before[1] - behind[1] - R * i[1]) - omega * i[0],
    )


def _lcl_law(x, u_r, v_in, delta_omega, L_F, R_F, C_F, L_g, R_g, omega_0):
    i_ti, e, i_g, omega = x[0:2], x[2:4], x[4:6], omega_0 + delta_omega
    rates = (
        *series_rate(u_r, e, i_ti, R_F, omega_0 / L_F, omega),
        *series_rate(i_ti, i_g, e, 0, omega_0 / C_F, omega),
        *series_rate(e, v_in, i_g, R_g, omega_0 / L_g, omega),
    )
    return rates, lcl_outputs(i_ti, e, i_g)


def lcl_outputs(i_ti, e, i_g):
    """i_ti, e, i_g, e_q, i_C of an LCL filter."""
    return (*i_ti, *e, *i_g, e[1], i_ti[0] - i_g[0], i_ti[1] - i_g[1])


def lcl_at_rest(i_ti_eq, e_eq, i_g_eq):
    """The states of an LCL filter."""
    return (*i_ti_eq, *e_eq, *i_g_eq)


LCL = ModuleKind(
    name="LCL",
    family="physical plant",
    law="L_F/omega_0 i_ti' = u_r - e - (R_F + L_F J) i_ti; C_F/omega_0 e' = i_ti - i_g - C_F J e; "
    "L_g/omega_0 i_g' = e - v_in - (R_g + L_g J) i_g; each state also - J x_eq delta_omega",
    inputs={"u_r": Signal.DQ_VEC, "v_in": Signal.DQ_VEC, "delta_omega": Signal.SCALAR},
    outputs={
        "i_ti": Signal.DQ_VEC,
        "e": Signal.DQ_VEC,
        "i_g": Signal.DQ_VEC,
        "e_q": Signal.SCALAR,
        "i_C": Signal.DQ_VEC,
    },
    states=("i_ti_d", "i_ti_q", "e_d", "e_q", "i_g_d", "i_g_q"),
    parameters={
        "L_F": INDUCTANCE,
        "R_F": RESISTANCE,
        "C_F": CAPACITANCE,
        "L_g": INDUCTANCE,
        "R_g": RESISTANCE,
    },
    state_space=lcl_matrices,
    equilibrium={"i_ti": "I0d", "e": "E0d", "i_g": "I0d"},
    reference="paper, appendix A.2 and equation (1)",
    large_signal=LargeSignal(_lcl_law, lcl_at_rest),
    branches=((None, "C_F"),),
)


def _l_filter(L_F, R_F, omega_0, i_g_eq):
    w, f = omega_0, omega_0 / L_F
    a = [[-f * R_F, w], [-w, -f * R_F]]
    b = [[f, 0, -f, 0, i_g_eq[1]], [0, f, 0, -f, -i_g_eq[0]]]
    c = [[1, 0], [0, 1], [0, 0], [0, 0], [0, 0]]
    d = [[0] * 5, [0] * 5, [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 1, 0]]
    return a, b, c, d


def _l_filter_law(x, u_r, v_in, delta_omega, L_F, R_F, omega_0):
    return series_rate(u_r, v_in, x, R_F, omega_0 / L_F, omega_0 + delta_omega), (
        *x,
        *v_in,
        v_in[1],
    )


def current_at_rest(i_g_eq):
    """The states of an L filter."""
    return i_g_eq


L_FILTER = ModuleKind(
    name="LFilter",
    family="physical plant",
    law="L_F/omega_0 i_g' = u_r - v_in - (R_F + L_F J) i_g - J i_eq delta_omega; e = v_in",
    inputs={"u_r": Signal.DQ_VEC, "v_in": Signal.DQ_VEC, "delta_omega": Signal.SCALAR},
    outputs={"i_g": Signal.DQ_VEC, "e": Signal.DQ_VEC, "e_q": Signal.SCALAR},
    states=("i_g_d", "i_g_q"),
    parameters={"L_F": INDUCTANCE, "R_F": RESISTANCE},
    state_space=_l_filter,
    equilibrium={"i_g": "I0d"},
    reference="paper, appendix A.2",
    large_signal=LargeSignal(_l_filter_law, current_at_rest),
    branches=(),
)
