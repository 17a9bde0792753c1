"""Branches beside the plant: passive shunts at the PCC, the capacitor of the DC link."""

from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.large_signal import LargeSignal, dot
from ibrid.signals import Signal

BRANCH = "physical branch"


def _shunt_rc(R, C, omega_0):
    w, k, y = omega_0, omega_0 / (R * C), 1 / R
    a = [[-k, w], [-w, -k]]
    return a, [[k, 0], [0, k]], [[y, 0], [0, y]], [[-y, 0], [0, -y]]


SHUNT_RC = ModuleKind(
    name="Shunt_RC",
    family=BRANCH,
    law="C/omega_0 v_C' = (v - v_C)/R - C J v_C, i = -(v - v_C)/R: a series R, C from v to neutral "
    "in the grid frame; "
    "like i_g its current counts out of the branch, so that i adds to i_DQ",
    inputs={"v": Signal.DQ_VEC},
    outputs={"i": Signal.DQ_VEC},
    states=("v_C_d", "v_C_q"),
    parameters={
        "R": Range(
            1e-4, 100.0, 0.1, "pu", "resistance in series with the shunt capacitor", divides=True
        ),
        "C": Range(
            1e-5,
            10.0,
            0.05,
            "pu",
            "shunt capacitance (susceptance at nominal frequency)",
            divides=True,
        ),
    },
    state_space=_shunt_rc,
    extended=True,
    reference="cable capacitance or an RC filter at the PCC, seen in a frame that turns at omega_0",
)


def _dc_link(C_dc, u_eq, i_eq):
    k = -1 / C_dc
    return [[0]], [[k * i_eq[0], k * i_eq[1], k * u_eq[0], k * u_eq[1]]], [[1]], [[0, 0, 0, 0]]


def _dc_link_law(x, u, i, C_dc, u_eq, i_eq):
    # the source delivers what the converter takes at rest
    surplus = dot(u_eq, i_eq) - dot(u, i)
    return (surplus / (C_dc * x[0]),), (x[0],)


def _dc_link_at_rest():
    return (1.0,)


DC_LINK = ModuleKind(
    name="DC_link",
    family=BRANCH,
    law="C_dc v_dc' v_dc = P_in - u' i about v_dc = 1, P_in constant; u takes what drives the "
    "plant's u_r, i its i_ti",
    inputs={"u": Signal.DQ_VEC, "i": Signal.DQ_VEC},
    outputs={"v_dc": Signal.SCALAR},
    states=("v_dc",),
    parameters={
        "C_dc": Range(
            1e-4,
            1.0,
            0.02,
            "s",
            "DC capacitance: twice the stored energy over the rating",
            divides=True,
        )
    },
    state_space=_dc_link,
    equilibrium={"u": "E0d", "i": "I0d"},
    extended=True,
    reference="power balance of the DC capacitor behind a constant power source",
    large_signal=LargeSignal(_dc_link_law, _dc_link_at_rest),
)
