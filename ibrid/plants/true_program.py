"""The block diagram that equals a grid-following reference inverter, as program text, with its true values."""

from ibrid.plants.gfl import GFLParameters


def true_values(parameters: GFLParameters, omega_0: float) -> dict[str, float]:
    """Values of the parameters of `true_program`, keyed as in the textbook programs; per unit, 1/s and rad/s."""
    m = parameters
    values = {"plant.L_F": m.L_F, "plant.R_F": m.R_F}
    if m.filter == "LCL":
        values |= {"plant.C_F": m.C_F, "plant.L_g": m.L_g, "plant.R_g": m.R_g}
    values |= {"pll.kP_pll": m.kP_pll, "pll.kI_pll": m.kI_pll}
    if m.omega_c_pll:
        values["pll_filter.omega_c"] = m.omega_c_pll
    values |= {"power.kP": m.kP_power, "power.kI": m.kI_power}
    if m.omega_c_power:
        values["power_filter.omega_c"] = m.omega_c_power
    values |= {"current.kP": m.kP_current, "current.kI": m.kI_current}
    if m.assumed_inductance:
        # JMul counts its inductance in seconds, JMul_omega in per unit
        values["decoupling.L"] = m.assumed_inductance / (omega_0 if m.decoupling == "nominal" else 1.0)
    if m.feedforward not in (0.0, 1.0):
        values["feedforward.k"] = m.feedforward
    return values


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
        ("PQ_calc", "power"),
        *([("LPF1", "p_filter"), ("LPF1", "q_filter")] if m.omega_c_power else []),
        ("Negate", "minus_p"),
        ("PI", "p_loop"),
        ("PI", "q_loop"),
        ("PackDQ", "i_ref"),
        ("Negate_dq", "minus_i"),
        ("PI_dq", "current"),
    ]
    shared = {
        "p_loop": ', kP="power.kP", kI="power.kI"',
        "q_loop": ', kP="power.kP", kI="power.kI"',
        "p_filter": ', omega_c="power_filter.omega_c"',
        "q_filter": ', omega_c="power_filter.omega_c"',
    }
    e_q = ["plant.e_q", "pll_filter.in_", "pll_filter.out"] if m.omega_c_pll else ["plant.e_q"]
    p = ["power.p", "p_filter.in_", "p_filter.out"] if m.omega_c_power else ["power.p"]
    q = ["power.q", "q_filter.in_", "q_filter.out"] if m.omega_c_power else ["power.q"]
    chains = [
        ["v_DQ", "park_v.v_DQ"],
        ["pll.delta", "park_v.delta"],
        ["park_v.v_dq", "plant.v_in"],
        ["pll.delta_omega", "plant.delta_omega"],
        [*e_q, "pll.e_q"],
        ["plant.e", "power.e"],
        ["plant.i_g", "power.i"],
        [*p, "minus_p.in_", "minus_p.out", "p_loop.in_", "p_loop.out", "i_ref.in_d"],
        [*q, "q_loop.in_", "q_loop.out", "i_ref.in_q"],
        ["i_ref.out", "current.in_"],
        [current, "minus_i.in_", "minus_i.out", "current.in_", "current.out", "plant.u_r"],
    ]
    if m.assumed_inductance:
        add.append(("JMul" if m.decoupling == "nominal" else "JMul_omega", "decoupling"))
        chains.append([current, "decoupling.in_", "decoupling.out", "plant.u_r"])
        if m.decoupling == "pll":
            chains.append(["pll.delta_omega", "decoupling.delta_omega"])
    if m.feedforward == 1.0:
        chains.append(["plant.e", "plant.u_r"])
    elif m.feedforward:
        add.append(("Gain_dq", "feedforward"))
        chains.append(["plant.e", "feedforward.in_", "feedforward.out", "plant.u_r"])
    chains += [["plant.i_g", "park_i.i_dq"], ["pll.delta", "park_i.delta"], ["park_i.i_DQ", "i_DQ"]]

    lines = ["def build_reference_inverter(g):"]
    lines += [f'    g.add("{kind}", "{name}"{shared.get(name, "")})' for kind, name in add]
    for chain in chains:
        # source, input, output of the same block, next input, ...
        lines += [f'    g.connect("{chain[k]}", "{chain[k + 1]}")' for k in range(0, len(chain), 2)]
    return "\n".join(lines) + "\n"
