"""What equals a grid-following reference inverter: its block diagram as program text, and the true
values of that.
"""

from ibrid.plants.gfl import GFLParameters


def true_values(parameters: GFLParameters, omega_0: float) -> dict[str, float]:
    """Values of the parameters of `true_program`, keyed as in the textbook programs; per unit, 1/s
    and rad/s.
    """
    m = parameters
    values: dict[str, float | None] = {"plant.L_F": m.L_F, "plant.R_F": m.R_F}
    if m.filter == "LCL":
        values |= {"plant.C_F": m.C_F, "plant.L_g": m.L_g, "plant.R_g": m.R_g}
    values |= {"pll.kP_pll": m.kP_pll, "pll.kI_pll": m.kI_pll, "pll_filter.omega_c": m.omega_c_pll}
    if "power" in (m.p_loop, m.q_loop):
        values |= {
            "power.kP": m.kP_power,
            "power.kI": m.kI_power,
            "power_filter.omega_c": m.omega_c_power,
        }
    if m.p_loop == "dc_link":
        values |= {"dc_link.C_dc": m.C_dc, "dc_loop.kP": m.kP_dc, "dc_loop.kI": m.kI_dc}
    if m.q_loop == "voltage":
        values |= {"ac_loop.kP": m.kP_ac, "ac_loop.kI": m.kI_ac}
    values |= {"current.kP": m.kP_current, "current.kI": m.kI_current}
    if m.assumed_inductance:
        # JMul counts its inductance in seconds, JMul_omega in per unit
        values["decoupling.L"] = m.assumed_inductance / (
            omega_0 if m.decoupling == "nominal" else 1.0
        )
    if m.feedforward not in (0.0, 1.0):
        values["feedforward.k"] = m.feedforward
    if m.k_damping:
        values["damping.k"] = -m.k_damping
    return {name: value for name, value in values.items() if value is not None}


def true_program(parameters: GFLParameters) -> str:
    """Program text with the names of the textbook programs; exact with equilibrium "exact"."""
    m = parameters
    current = "plant.i_ti" if m.filter == "LCL" else "plant.i_g"
    add = [
        ("Rot_v", "park_v"),
        ("LCL" if m.filter == "LCL" else "LFilter", "plant"),
        ("Rot_i", "park_i"),
        *([("LPF1", "pll_filter")] if m.omega_c_pll else []),
        ("SRF_PLL", "pll"),
    ]
    e_q = ["plant.e_q", "pll_filter.in_", "pll_filter.out"] if m.omega_c_pll else ["plant.e_q"]
    chains = [
        ["v_DQ", "park_v.v_DQ"],
        ["pll.delta", "park_v.delta"],
        ["park_v.v_dq", "plant.v_in"],
        ["pll.delta_omega", "plant.delta_omega"],
        [*e_q, "pll.e_q"],
    ]
    for made in (_power_loops(m), _voltage_loops(m, current)):
        add += made[0]
        chains += made[1]
    add += [("PackDQ", "i_ref"), ("Negate_dq", "minus_i"), ("PI_dq", "current")]
    chains += [["i_ref.out", "current.in_"], [current, "minus_i.in_", "minus_i.out", "current.in_"]]
    terms = [["current.out"]]
    if m.assumed_inductance:
        add.append(("JMul" if m.decoupling == "nominal" else "JMul_omega", "decoupling"))
        terms.append([current, "decoupling.in_", "decoupling.out"])
        if m.decoupling == "pll":
            chains.append(["pll.delta_omega", "decoupling.delta_omega"])
    if m.feedforward == 1.0:
        terms.append(["plant.e"])
    elif m.feedforward:
        add.append(("Gain_dq", "feedforward"))
        terms.append(["plant.e", "feedforward.in_", "feedforward.out"])
    if m.k_damping:
        add.append(("Gain_dq", "damping"))
        terms.append(["plant.i_C", "damping.in_", "damping.out"])
    chains += [[*term, "plant.u_r"] for term in terms]
    if m.p_loop == "dc_link":
        chains += [[term[-1], "dc_link.u"] for term in terms]
    chains += [["plant.i_g", "park_i.i_dq"], ["pll.delta", "park_i.delta"], ["park_i.i_DQ", "i_DQ"]]

    lines = ["def build_reference_inverter(g):"]
    lines += [f'    g.add("{kind}", "{name}"{_SHARED.get(name, "")})' for kind, name in add]
    for chain in chains:
        # source, input, output of the same block, next input, ...
        lines += [f'    g.connect("{chain[k]}", "{chain[k + 1]}")' for k in range(0, len(chain), 2)]
    return "\n".join(lines) + "\n"


_SHARED = {
    "p_loop": ', kP="power.kP", kI="power.kI"',
    "q_loop": ', kP="power.kP", kI="power.kI"',
    "p_filter": ', omega_c="power_filter.omega_c"',
    "q_filter": ', omega_c="power_filter.omega_c"',
}
#: Modules (kind, name), and chains of ports.
_Part = tuple[list[tuple[str, str]], list[list[str]]]


def _power_loops(m: GFLParameters) -> _Part:
    """From e and i_g to the current reference on the axes that control power."""
    controlled = [name for name, loop in (("p", m.p_loop), ("q", m.q_loop)) if loop == "power"]
    if not controlled:
        return [], []
    add = [("PQ_calc", "power")]
    chains = [["plant.e", "power.e"], ["plant.i_g", "power.i"]]
    if m.omega_c_power:
        add += [("LPF1", f"{name}_filter") for name in controlled]
    if "p" in controlled:
        add.append(("Negate", "minus_p"))
    for name in controlled:
        add.append(("PI", f"{name}_loop"))
        path = [f"power.{name}"]
        path += [f"{name}_filter.in_", f"{name}_filter.out"] if m.omega_c_power else []
        path += ["minus_p.in_", "minus_p.out"] if name == "p" else []
        chains.append(
            [
                *path,
                f"{name}_loop.in_",
                f"{name}_loop.out",
                f"i_ref.in_{'d' if name == 'p' else 'q'}",
            ]
        )
    return add, chains


def _voltage_loops(m: GFLParameters, current: str) -> _Part:
    """From the DC link, and from the magnitude of e, to the current reference; what drives the link
    is wired later.
    """
    add: list[tuple[str, str]] = []
    chains: list[list[str]] = []
    if m.p_loop == "dc_link":
        add += [("DC_link", "dc_link"), ("PI", "dc_loop")]
        chains += [
            [current, "dc_link.i"],
            ["dc_link.v_dc", "dc_loop.in_", "dc_loop.out", "i_ref.in_d"],
        ]
    if m.q_loop == "voltage":
        add += [("Magnitude", "e_size"), ("PI", "ac_loop")]
        chains += [
            ["plant.e", "e_size.in_", "e_size.out", "ac_loop.in_", "ac_loop.out", "i_ref.in_q"]
        ]
    return add, chains
