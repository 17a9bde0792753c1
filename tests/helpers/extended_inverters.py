"""Inverters of damped filters, lines, shunts and a DC link: as program text, and at values that are
stable.
"""

from dataclasses import dataclass

M = {
    "L_F": 0.15,
    "R_F": 0.01,
    "C_F": 0.07,
    "L_g": 0.12,
    "R_g": 0.02,
    "R_C": 0.2,
    "R_d": 0.6,
    "C_d": 0.09,
    "R_s": 0.07,
    "C_s": 0.11,
    "C_dc": 0.015,
    "kP_pll": 60.0,
    "kI_pll": 1400.0,
    "kP_1": 0.3,
    "kI_1": 15.0,
    "kP_2": 0.2,
    "kI_2": 9.0,
    "kP_i": 0.5,
    "kI_i": 15.0,
    "L_d": 0.13,
    "k_ff": 0.8,
    "I_s": 1.3,
}


@dataclass(frozen=True)
class Inverter:
    """What differs.

    `outer`: "power", p and q loops, or "voltage": a DC link and the magnitude of e. `pll` : what it
    locks.
    """

    plant: str = "LCL"
    outer: str = "power"
    pll: str = "e"
    shunt: bool = False


def program(inverter: Inverter) -> str:
    """The same as text."""
    current = "i_g" if inverter.plant in ("LFilter", "LLFilter") else "i_ti"
    add = [(inverter.plant, "plant"), ("Rot_v", "park_v"), ("Rot_i", "park_i"), ("SRF_PLL", "pll")]
    add += [
        ("PI", "first"),
        ("PI", "second"),
        ("PackDQ", "i_ref"),
        ("Negate_dq", "minus_i"),
        ("PI_dq", "current"),
    ]
    add += [("JMul_omega", "decoupling"), ("Gain_dq", "feedforward")]
    wires = [
        ("v_DQ", "park_v.v_DQ"),
        ("pll.delta", "park_v.delta"),
        ("park_v.v_dq", "plant.v_in"),
        ("plant.i_g", "park_i.i_dq"),
        ("pll.delta", "park_i.delta"),
        ("park_i.i_DQ", "i_DQ"),
        ("pll.delta_omega", "plant.delta_omega"),
        ("pll.delta_omega", "decoupling.delta_omega"),
        ("first.out", "i_ref.in_d"),
        ("second.out", "i_ref.in_q"),
        ("i_ref.out", "current.in_"),
        (f"plant.{current}", "minus_i.in_"),
        ("minus_i.out", "current.in_"),
        (f"plant.{current}", "decoupling.in_"),
        ("plant.e", "feedforward.in_"),
    ]
    command = [f"{name}.out" for name in ("current", "decoupling", "feedforward")]
    wires += [(one, "plant.u_r") for one in command]
    if inverter.pll == "e":
        wires += [("plant.e_q", "pll.e_q")]
    else:
        add += [("SliceQ", "v_q")]
        wires += [("park_v.v_dq", "v_q.in_"), ("v_q.out", "pll.e_q")]
    if inverter.outer == "power":
        add += [("PQ_calc", "power"), ("Negate", "minus_p")]
        wires += [("plant.e", "power.e"), ("plant.i_g", "power.i"), ("power.p", "minus_p.in_")]
        wires += [("minus_p.out", "first.in_"), ("power.q", "second.in_")]
    else:
        add += [("DC_link", "dc_link"), ("Magnitude", "magnitude")]
        wires += [(one, "dc_link.u") for one in reversed(command)] + [
            (f"plant.{current}", "dc_link.i")
        ]
        wires += [
            ("dc_link.v_dc", "first.in_"),
            ("plant.e", "magnitude.in_"),
            ("magnitude.out", "second.in_"),
        ]
    if inverter.shunt:
        add += [("Shunt_RC", "shunt")]
        wires += [("v_DQ", "shunt.v"), ("shunt.i", "i_DQ")]
    lines = [f'g.add("{kind}", "{name}")' for kind, name in add] + [
        f'g.connect("{a}", "{b}")' for a, b in wires
    ]
    return "def build(g):\n" + "\n".join(f"    {line}" for line in lines)


VALUES = {
    "pll.kP_pll": M["kP_pll"],
    "pll.kI_pll": M["kI_pll"],
    "first.kP": M["kP_1"],
    "first.kI": M["kI_1"],
    "second.kP": M["kP_2"],
    "second.kI": M["kI_2"],
    "current.kP": M["kP_i"],
    "current.kI": M["kI_i"],
    "decoupling.L": M["L_d"],
    "feedforward.k": M["k_ff"],
    "dc_link.C_dc": M["C_dc"],
    "shunt.R": M["R_s"],
    "shunt.C": M["C_s"],
    **{
        f"plant.{name}": M[name]
        for name in ("L_F", "R_F", "C_F", "L_g", "R_g", "R_C", "R_d", "C_d", "I_s")
    },
}
