"""Output filters beside those of the paper: an LCL whose capacitor is damped or has a trap, or
whose core saturates, an L filter behind a line.

Conventions as in `ibrid.modules.plant`. What a further branch holds at rest follows from the
equilibria of the ports: a capacitance C behind a resistance R, at the voltage e, holds v_C = e / (1
+ R C J).
"""

from dataclasses import replace

from ibrid.modules.kind import Range
from ibrid.modules.large_signal import LargeSignal, dot, square_root
from ibrid.modules.plant import (
    CAPACITANCE,
    INDUCTANCE,
    L_FILTER,
    LCL,
    RESISTANCE,
    current_at_rest,
    lcl_at_rest,
    lcl_matrices,
    lcl_outputs,
    series_rate,
)

DAMPING = Range(1e-5, 10.0, 0.05, "pu", "resistance of the capacitor branch")


def _behind_resistor(R_C, i_ti, e, i_g):
    return e[0] - R_C * (i_ti[0] - i_g[0]), e[1] - R_C * (i_ti[1] - i_g[1])


def _lcl_r(L_F, R_F, C_F, L_g, R_g, R_C, omega_0, i_ti_eq, e_eq, i_g_eq):
    v_c_eq = _behind_resistor(R_C, i_ti_eq, e_eq, i_g_eq)
    a, b, c, d = lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, v_c_eq, i_g_eq)
    a, c = [list(row) for row in a], [list(row) for row in c]
    f, g = omega_0 / L_F * R_C, omega_0 / L_g * R_C
    for i_ti, e, i_g in ((0, 2, 4), (1, 3, 5)):  # e = v_C + R_C (i_ti - i_g) where v_C alone stood
        a[i_ti][i_ti], a[i_ti][i_g] = a[i_ti][i_ti] - f, a[i_ti][i_g] + f
        a[i_g][i_ti], a[i_g][i_g] = a[i_g][i_ti] + g, a[i_g][i_g] - g
        c[e][i_ti], c[e][i_g] = R_C, -R_C
    c[6] = c[3]  # e_q
    return a, b, c, d


def _lcl_r_law(x, u_r, v_in, delta_omega, L_F, R_F, C_F, L_g, R_g, R_C, omega_0):
    i_ti, v_c, i_g, omega = x[0:2], x[2:4], x[4:6], omega_0 + delta_omega
    e = (v_c[0] + R_C * (i_ti[0] - i_g[0]), v_c[1] + R_C * (i_ti[1] - i_g[1]))
    rates = (
        *series_rate(u_r, e, i_ti, R_F, omega_0 / L_F, omega),
        *series_rate(i_ti, i_g, v_c, 0, omega_0 / C_F, omega),
        *series_rate(e, v_in, i_g, R_g, omega_0 / L_g, omega),
    )
    return rates, lcl_outputs(i_ti, e, i_g)


def _lcl_r_at_rest(R_C, i_ti_eq, e_eq, i_g_eq):
    return (*i_ti_eq, *_behind_resistor(R_C, i_ti_eq, e_eq, i_g_eq), *i_g_eq)


LCL_R = replace(
    LCL,
    name="LCL_R",
    law="LCL with a resistor in series with its capacitor: e = v_C + R_C (i_ti - i_g), "
    "C_F/omega_0 v_C' = i_ti - i_g - C_F J v_C - C_F/omega_0 J v_C_eq delta_omega; i_ti and i_g as "
    "in LCL",
    states=("i_ti_d", "i_ti_q", "v_C_d", "v_C_q", "i_g_d", "i_g_q"),
    parameters={**LCL.parameters, "R_C": DAMPING},
    state_space=_lcl_r,
    extended=True,
    reference="passive damping of LCL filters; equation (1) of the paper with the resistor",
    large_signal=LargeSignal(_lcl_r_law, _lcl_r_at_rest),
    branches=(("R_C", "C_F"),),
)


def _held_voltage(R_d, C_d, e):
    x = R_d * C_d
    return (e[0] + x * e[1]) / (1 + x * x), (e[1] - x * e[0]) / (1 + x * x)


def _lcl_rc(L_F, R_F, C_F, L_g, R_g, R_d, C_d, omega_0, i_ti_eq, e_eq, i_g_eq):
    v_eq = _held_voltage(R_d, C_d, e_eq)
    a, b, c, d = lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, e_eq, i_g_eq)
    h, k, w = omega_0 / (C_F * R_d), omega_0 / (C_d * R_d), omega_0
    a = [[*row, 0, 0] for row in a]
    a[2][2], a[2][6] = a[2][2] - h, h
    a[3][3], a[3][7] = a[3][3] - h, h
    a += [[0, 0, k, 0, 0, 0, -k, w], [0, 0, 0, k, 0, 0, -w, -k]]
    b = [*b, [0, 0, 0, 0, v_eq[1]], [0, 0, 0, 0, -v_eq[0]]]
    return a, b, [[*row, 0, 0] for row in c], d


def _lcl_rc_law(x, u_r, v_in, delta_omega, L_F, R_F, C_F, L_g, R_g, R_d, C_d, omega_0):
    i_ti, e, i_g, v_d, omega = x[0:2], x[2:4], x[4:6], x[6:8], omega_0 + delta_omega
    i_d = ((e[0] - v_d[0]) / R_d, (e[1] - v_d[1]) / R_d)
    rates = (
        *series_rate(u_r, e, i_ti, R_F, omega_0 / L_F, omega),
        *series_rate((i_ti[0] - i_d[0], i_ti[1] - i_d[1]), i_g, e, 0, omega_0 / C_F, omega),
        *series_rate(e, v_in, i_g, R_g, omega_0 / L_g, omega),
        *series_rate(i_d, (0, 0), v_d, 0, omega_0 / C_d, omega),
    )
    return rates, lcl_outputs(i_ti, e, i_g)


def _lcl_rc_at_rest(R_d, C_d, i_ti_eq, e_eq, i_g_eq):
    return (*i_ti_eq, *e_eq, *i_g_eq, *_held_voltage(R_d, C_d, e_eq))


LCL_RC = replace(
    LCL,
    name="LCL_RC",
    law="LCL with a series R_d, C_d beside its capacitor: C_F/omega_0 e' = i_ti - i_g - i_d - C_F "
    "J e, "
    "i_d = (e - v_d)/R_d, C_d/omega_0 v_d' = i_d - C_d J v_d; each state also - J x_eq "
    "delta_omega; i_C = i_ti - i_g "
    "is the current of both branches",
    states=(*LCL.states, "v_d_d", "v_d_q"),
    parameters={
        **LCL.parameters,
        "R_d": replace(DAMPING, typical=0.5, divides=True),
        "C_d": CAPACITANCE,
    },
    state_space=_lcl_rc,
    extended=True,
    reference="passive damping of LCL filters; equation (1) of the paper with the branch",
    large_signal=LargeSignal(_lcl_rc_law, _lcl_rc_at_rest),
    branches=((None, "C_F"), ("R_d", "C_d")),
)


def _trap_at_rest(L_t, C_t, R_t, e):
    x, square = L_t - 1 / C_t, R_t * R_t + (L_t - 1 / C_t) * (L_t - 1 / C_t)
    i = (R_t * e[0] + x * e[1]) / square, (R_t * e[1] - x * e[0]) / square
    return i, (i[1] / C_t, -i[0] / C_t)


def _lcl_trap(L_F, R_F, C_F, L_g, R_g, L_t, C_t, R_t, omega_0, i_ti_eq, e_eq, i_g_eq):
    i_eq, v_eq = _trap_at_rest(L_t, C_t, R_t, e_eq)
    a, b, c, d = lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, e_eq, i_g_eq)
    h, f, k, w = omega_0 / C_F, omega_0 / L_t, omega_0 / C_t, omega_0
    a = [[*row, 0, 0, 0, 0] for row in a]
    a[2][6] = a[3][7] = -h
    a += [[0, 0, f, 0, 0, 0, -f * R_t, w, -f, 0], [0, 0, 0, f, 0, 0, -w, -f * R_t, 0, -f]]
    a += [[0, 0, 0, 0, 0, 0, k, 0, 0, w], [0, 0, 0, 0, 0, 0, 0, k, -w, 0]]
    b = [*b, *([0, 0, 0, 0, turned] for z in (i_eq, v_eq) for turned in (z[1], -z[0]))]
    return a, b, [[*row, 0, 0, 0, 0] for row in c], d


def _lcl_trap_law(x, u_r, v_in, delta_omega, L_F, R_F, C_F, L_g, R_g, L_t, C_t, R_t, omega_0):
    i_ti, e, i_g, i_t, v_t, omega = x[0:2], x[2:4], x[4:6], x[6:8], x[8:10], omega_0 + delta_omega
    rates = (
        *series_rate(u_r, e, i_ti, R_F, omega_0 / L_F, omega),
        *series_rate((i_ti[0] - i_t[0], i_ti[1] - i_t[1]), i_g, e, 0, omega_0 / C_F, omega),
        *series_rate(e, v_in, i_g, R_g, omega_0 / L_g, omega),
        *series_rate(e, v_t, i_t, R_t, omega_0 / L_t, omega),
        *series_rate(i_t, (0, 0), v_t, 0, omega_0 / C_t, omega),
    )
    return rates, lcl_outputs(i_ti, e, i_g)


def _lcl_trap_at_rest(L_t, C_t, R_t, i_ti_eq, e_eq, i_g_eq):
    i_t, v_t = _trap_at_rest(L_t, C_t, R_t, e_eq)
    return (*i_ti_eq, *e_eq, *i_g_eq, *i_t, *v_t)


LCL_TRAP = replace(
    LCL,
    name="LCL_trap",
    law="LCL with a series L_t, R_t, C_t beside its capacitor, tuned to the switching frequency: "
    "C_F/omega_0 e' = i_ti - i_g "
    "- i_t - C_F J e, L_t/omega_0 i_t' = e - v_t - (R_t + L_t J) i_t, C_t/omega_0 v_t' = i_t - C_t "
    "J v_t; each state also "
    "- J x_eq delta_omega; i_C = i_ti - i_g is the current of both branches",
    states=(*LCL.states, "i_t_d", "i_t_q", "v_t_d", "v_t_q"),
    parameters={
        **LCL.parameters,
        "L_t": Range(1e-6, 1.0, 2e-3, "pu", "inductance of the trap", divides=True),
        "C_t": replace(CAPACITANCE, typical=0.02),
        "R_t": replace(DAMPING, typical=2e-3),
    },
    state_space=_lcl_trap,
    extended=True,
    reference="trap filter: W. Wu, Y. He and F. Blaabjerg, IEEE TPEL 27 (2012); equation (1) of "
    "the paper with the branch",
    large_signal=LargeSignal(_lcl_trap_law, _lcl_trap_at_rest),
    branches=((None, "C_F"), ("R_t", "C_t", "L_t")),
)


def _saturation(i, I_s):
    """By how much the inductance is smaller than without current."""
    return square_root(1 + dot(i, i) / (I_s * I_s))


def _reactance_at_rest(i, L_F, I_s, **_):
    return L_F / _saturation(i, I_s)


def _winding(i, I_s):
    """L_F d i / d psi, of the flux psi = L_F i / sqrt(1 + |i|^2/I_s^2)."""
    less, k = _saturation(i, I_s), I_s * I_s
    cross = less * i[0] * i[1] / k
    return (less * (1 + i[0] * i[0] / k), cross), (cross, less * (1 + i[1] * i[1] / k))


def _lcl_saturated(L_F, R_F, C_F, L_g, R_g, I_s, omega_0, u_r_eq, i_ti_eq, e_eq, i_g_eq):
    a, b, c, d = lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, e_eq, i_g_eq)
    i, k, f, less = i_ti_eq, I_s * I_s, omega_0 / L_F, _saturation(i_ti_eq, I_s)
    v = [u_r_eq[axis] - e_eq[axis] - R_F * i[axis] for axis in (0, 1)]
    power = dot(i, v)
    for row, gains in enumerate(_winding(i, I_s)):
        driven = dot(gains, v)
        for axis, gain in enumerate(gains):
            same = 1 if axis == row else 0
            slope = driven * i[axis] / (k * less * less) + less / k * (
                power * same + i[row] * v[axis]
            )
            a[row][axis] = a[row][axis] + f * (R_F * (same - gain) + slope)
            a[row][2 + axis], b[row][axis] = -f * gain, f * gain
    return a, b, c, d


def _lcl_saturated_law(x, u_r, v_in, delta_omega, L_F, R_F, C_F, L_g, R_g, I_s, omega_0):
    i_ti, e, i_g, omega = x[0:2], x[2:4], x[4:6], omega_0 + delta_omega
    v = (u_r[0] - e[0] - R_F * i_ti[0], u_r[1] - e[1] - R_F * i_ti[1])
    driven = [dot(gains, v) for gains in _winding(i_ti, I_s)]
    rates = (
        *series_rate(driven, (0, 0), i_ti, 0, omega_0 / L_F, omega),
        *series_rate(i_ti, i_g, e, 0, omega_0 / C_F, omega),
        *series_rate(e, v_in, i_g, R_g, omega_0 / L_g, omega),
    )
    return rates, lcl_outputs(i_ti, e, i_g)


LCL_SATURATED = replace(
    LCL,
    name="LCL_saturated",
    law="LCL whose converter-side core saturates: psi = L_F i_ti/sqrt(1 + |i_ti|^2/I_s^2) in place "
    "of L_F i_ti, psi'/omega_0 = "
    "u_r - e - R_F i_ti - omega/omega_0 J psi; the rest as in LCL",
    parameters={
        **LCL.parameters,
        "I_s": Range(
            0.3, 100.0, 2.0, "pu", "current at which L_F is 1/sqrt(2) of itself", divides=True
        ),
    },
    state_space=_lcl_saturated,
    equilibrium={**LCL.equilibrium, "u_r": "E0d"},
    extended=True,
    reference="inductance of powder cores against bias; equation (1) of the paper with the flux of "
    "an averaged winding",
    large_signal=LargeSignal(_lcl_saturated_law, lcl_at_rest),
    reactance_at_rest=_reactance_at_rest,
)


def _ll_filter(L_F, R_F, L_g, R_g, omega_0, i_g_eq):
    w, whole = omega_0, L_F + L_g
    f, r = omega_0 / whole, R_F + R_g
    a = [[-f * r, w], [-w, -f * r]]
    b = [[f, 0, -f, 0, i_g_eq[1]], [0, f, 0, -f, -i_g_eq[0]]]
    share, drop = L_g / whole, R_g - r * L_g / whole
    e = [[drop, 0], [0, drop]]
    through = [[share, 0, 1 - share, 0, 0], [0, share, 0, 1 - share, 0]]
    return a, b, [[1, 0], [0, 1], *e, e[1]], [[0] * 5, [0] * 5, *through, through[1]]


def _ll_filter_law(x, u_r, v_in, delta_omega, L_F, R_F, L_g, R_g, omega_0):
    whole, r, omega = L_F + L_g, R_F + R_g, omega_0 + delta_omega
    rates = series_rate(u_r, v_in, x, r, omega_0 / whole, omega)
    # L_g (i_g'/omega_0 + omega/omega_0 J i_g) is the part L_g/(L_F + L_g) of what drives the
    # current
    e = [v_in[k] + R_g * x[k] + L_g / whole * (u_r[k] - v_in[k] - r * x[k]) for k in (0, 1)]
    return rates, (*x, *e, e[1])


LL_FILTER = replace(
    L_FILTER,
    name="LLFilter",
    law="L filter with a line or transformer between the measured voltage e and v_in: (L_F + "
    "L_g)/omega_0 i_g' = u_r - "
    "v_in - (R_F + R_g + (L_F + L_g) J) i_g - (L_F + L_g)/omega_0 J i_eq delta_omega; "
    "e = v_in + R_g i_g + L_g (i_g'/omega_0 + J i_g), its frequency included",
    parameters={**L_FILTER.parameters, "L_g": INDUCTANCE, "R_g": RESISTANCE},
    state_space=_ll_filter,
    extended=True,
    reference="equation (1) of the paper without the capacitor",
    large_signal=LargeSignal(_ll_filter_law, current_at_rest),
)
