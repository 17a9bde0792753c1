def build_gfl_dc_link_q(g):
    """Grid-following with the DC link's voltage on the d axis and reactive power on the q axis (Yazdani and Iravani 2010, ch. 8).
    """
    # frames and plant
    g.add("Rot_v", "park_v")
    g.add("LCL", "plant")
    g.add("Rot_i", "park_i")
    # synchronisation
    g.add("SRF_PLL", "pll")
    # DC link and its voltage control
    g.add("DC_link", "dc_link")
    g.add("PI", "dc_loop")
    # reactive power
    g.add("PQ_calc", "power")
    g.add("PI", "q_loop")
    g.add("PackDQ", "i_ref")
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
    g.connect("dc_link.v_dc", "dc_loop.in_")
    g.connect("plant.e", "power.e")
    g.connect("plant.i_g", "power.i")
    g.connect("power.q", "q_loop.in_")
    g.connect("dc_loop.out", "i_ref.in_d")
    g.connect("q_loop.out", "i_ref.in_q")
    g.connect("i_ref.out", "current.in_")
    g.connect("plant.i_ti", "minus_i.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("plant.i_ti", "decoupling.in_")
    g.connect("pll.delta_omega", "decoupling.delta_omega")
    g.connect("current.out", "plant.u_r")
    g.connect("decoupling.out", "plant.u_r")
    g.connect("plant.e", "plant.u_r")
    g.connect("current.out", "dc_link.u")
    g.connect("decoupling.out", "dc_link.u")
    g.connect("plant.e", "dc_link.u")
    g.connect("plant.i_ti", "dc_link.i")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("pll.delta", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
