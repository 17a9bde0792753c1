"""Output filters beside those of the paper: an LCL whose capacitor is damped, an L filter behind a line.

Conventions as in `ibrid.modules.plant`. What a further branch holds at rest follows from the equilibria of the ports:
a capacitance C behind a resistance R, at the voltage e, holds v_C = e / (1 + R C J).
"""

from dataclasses import replace

from ibrid.modules.kind import Range
from ibrid.modules.plant import CAPACITANCE, INDUCTANCE, L_FILTER, LCL, RESISTANCE, lcl_matrices

DAMPING = Range(1e-5, 10.0, 0.05, "pu", "resistance of the capacitor branch")


def _lcl_r(L_F, R_F, C_F, L_g, R_g, R_C, omega_0, i_ti_eq, e_eq, i_g_eq):
    v_c_eq = (e_eq[0] - R_C * (i_ti_eq[0] - i_g_eq[0]), e_eq[1] - R_C * (i_ti_eq[1] - i_g_eq[1]))
    a, b, c, d = lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, v_c_eq, i_g_eq)
    a, c = [list(row) for row in a], [list(row) for row in c]
    f, g = omega_0 / L_F * R_C, omega_0 / L_g * R_C
    for i_ti, e, i_g in ((0, 2, 4), (1, 3, 5)):  # e = v_C + R_C (i_ti - i_g) where v_C alone stood
        a[i_ti][i_ti], a[i_ti][i_g] = a[i_ti][i_ti] - f, a[i_ti][i_g] + f
        a[i_g][i_ti], a[i_g][i_g] = a[i_g][i_ti] + g, a[i_g][i_g] - g
        c[e][i_ti], c[e][i_g] = R_C, -R_C
    c[6] = c[3]  # e_q
    return a, b, c, d


LCL_R = replace(
    LCL,
    name="LCL_R",
    law="LCL with a resistor in series with its capacitor: e = v_C + R_C (i_ti - i_g), "
    "C_F/omega_0 v_C' = i_ti - i_g - C_F J v_C - C_F/omega_0 J v_C_eq delta_omega; i_ti and i_g as in LCL",
    states=("i_ti_d", "i_ti_q", "v_C_d", "v_C_q", "i_g_d", "i_g_q"),
    parameters={**LCL.parameters, "R_C": DAMPING},
    state_space=_lcl_r,
    extended=True,
    reference="passive damping of LCL filters; equation (1) of the paper with the resistor",
)


def _lcl_rc(L_F, R_F, C_F, L_g, R_g, R_d, C_d, omega_0, i_ti_eq, e_eq, i_g_eq):
    x = R_d * C_d
    v_eq = ((e_eq[0] + x * e_eq[1]) / (1 + x * x), (e_eq[1] - x * e_eq[0]) / (1 + x * x))
    a, b, c, d = lcl_matrices(L_F, R_F, C_F, L_g, R_g, omega_0, i_ti_eq, e_eq, i_g_eq)
    h, k, w = omega_0 / (C_F * R_d), omega_0 / (C_d * R_d), omega_0
    a = [[*row, 0, 0] for row in a]
    a[2][2], a[2][6] = a[2][2] - h, h
    a[3][3], a[3][7] = a[3][3] - h, h
    a += [[0, 0, k, 0, 0, 0, -k, w], [0, 0, 0, k, 0, 0, -w, -k]]
    b = [*b, [0, 0, 0, 0, v_eq[1]], [0, 0, 0, 0, -v_eq[0]]]
    return a, b, [[*row, 0, 0] for row in c], d


LCL_RC = replace(
    LCL,
    name="LCL_RC",
    law="LCL with a series R_d, C_d beside its capacitor: C_F/omega_0 e' = i_ti - i_g - i_d - C_F J e, "
    "i_d = (e - v_d)/R_d, C_d/omega_0 v_d' = i_d - C_d J v_d; each state also - J x_eq delta_omega; i_C = i_ti - i_g "
    "is the current of both branches",
    states=(*LCL.states, "v_d_d", "v_d_q"),
    parameters={**LCL.parameters, "R_d": replace(DAMPING, typical=0.5, divides=True), "C_d": CAPACITANCE},
    state_space=_lcl_rc,
    extended=True,
    reference="passive damping of LCL filters; equation (1) of the paper with the branch",
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


LL_FILTER = replace(
    L_FILTER,
    name="LLFilter",
    law="L filter with a line or transformer between the measured voltage e and v_in: (L_F + L_g)/omega_0 i_g' = u_r - "
    "v_in - (R_F + R_g + (L_F + L_g) J) i_g - (L_F + L_g)/omega_0 J i_eq delta_omega; "
    "e = v_in + R_g i_g + L_g (i_g'/omega_0 + J i_g), its frequency included",
    parameters={**L_FILTER.parameters, "L_g": INDUCTANCE, "R_g": RESISTANCE},
    state_space=_ll_filter,
    extended=True,
    reference="equation (1) of the paper without the capacitor",
)
