def build_gfl_open_loop(g):
    """Grid-following without power loops: i_ref = (p*, -q*)/|v| of the filtered voltage (Yazdani and Iravani 2010)."""
    # frames and plant
    g.add("Rot_v", "park_v")
    g.add("LCL", "plant")
    g.add("Rot_i", "park_i")
    # synchronisation
    g.add("SRF_PLL", "pll")
    # references from powers and voltage
    g.add("LPF1_dq", "e_filter")
    g.add("Ref_pq", "i_ref")
    # current control with decoupling at the PLL's frequency
    g.add("Negate_dq", "minus_i")
    g.add("PI_dq", "current")
    g.add("JMul_omega", "decoupling")
    # wiring
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("pll.delta", "park_v.delta")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("pll.delta_omega", "plant.delta_omega")
    g.connect("plant.e_q", "pll.e_q")
    g.connect("plant.e", "e_filter.in_")
    g.connect("e_filter.out", "i_ref.v")
    g.connect("plant.i_ti", "i_ref.i")
    g.connect("i_ref.out", "current.in_")
    g.connect("plant.i_ti", "minus_i.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("plant.i_ti", "decoupling.in_")
    g.connect("pll.delta_omega", "decoupling.delta_omega")
    g.connect("current.out", "plant.u_r")
    g.connect("decoupling.out", "plant.u_r")
    g.connect("plant.e", "plant.u_r")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("pll.delta", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
