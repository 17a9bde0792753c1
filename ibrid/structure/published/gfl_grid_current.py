def build_gfl_grid_current(g):
    """Grid-following control of the grid current, the resonance damped by the capacitor's current (Pan et al., TIE 2014).
    """
    # frames and plant
    g.add("Rot_v", "park_v")
    g.add("LCL", "plant")
    g.add("Rot_i", "park_i")
    # synchronisation
    g.add("SRF_PLL", "pll")
    # power control
    g.add("PQ_calc", "power")
    g.add("Negate", "minus_p")
    g.add("PI", "p_loop")
    g.add("PI", "q_loop")
    g.add("PackDQ", "i_ref")
    # current control with decoupling at the PLL's frequency
    g.add("Negate_dq", "minus_i")
    g.add("PI_dq", "current")
    g.add("JMul_omega", "decoupling")
    # active damping
    g.add("Gain_dq", "damping")
    g.add("Negate_dq", "minus_damping")
    # wiring
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("pll.delta", "park_v.delta")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("pll.delta_omega", "plant.delta_omega")
    g.connect("plant.e_q", "pll.e_q")
    g.connect("plant.e", "power.e")
    g.connect("plant.i_g", "power.i")
    g.connect("power.p", "minus_p.in_")
    g.connect("power.q", "q_loop.in_")
    g.connect("minus_p.out", "p_loop.in_")
    g.connect("p_loop.out", "i_ref.in_d")
    g.connect("q_loop.out", "i_ref.in_q")
    g.connect("i_ref.out", "current.in_")
    g.connect("plant.i_g", "minus_i.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("plant.i_g", "decoupling.in_")
    g.connect("pll.delta_omega", "decoupling.delta_omega")
    g.connect("current.out", "plant.u_r")
    g.connect("decoupling.out", "plant.u_r")
    g.connect("plant.i_C", "damping.in_")
    g.connect("damping.out", "minus_damping.in_")
    g.connect("minus_damping.out", "plant.u_r")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("pll.delta", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
