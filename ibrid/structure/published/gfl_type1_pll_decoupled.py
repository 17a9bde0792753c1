def build_gfl_type1_pll_decoupled(g):
    """Grid-following, constant current reference, decoupling at the frequency of a type-1 PLL, without integral action (Gardner 2005)."""
    # frames and plant
    g.add("Rot_v", "park_v")
    g.add("LFilter", "plant")
    g.add("Rot_i", "park_i")
    # synchronisation
    g.add("LPF1", "pll_filter")
    g.add("SRF_PLL_P", "pll")
    # current control
    g.add("Negate_dq", "minus_i")
    g.add("PI_dq", "current")
    g.add("JMul_omega", "decoupling")
    # wiring
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("pll.delta", "park_v.delta")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("pll.delta_omega", "plant.delta_omega")
    g.connect("plant.e_q", "pll_filter.in_")
    g.connect("pll_filter.out", "pll.e_q")
    g.connect("plant.i_g", "minus_i.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("plant.i_g", "decoupling.in_")
    g.connect("pll.delta_omega", "decoupling.delta_omega")
    g.connect("current.out", "plant.u_r")
    g.connect("decoupling.out", "plant.u_r")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("pll.delta", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
