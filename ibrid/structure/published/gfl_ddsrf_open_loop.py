def build_gfl_ddsrf_open_loop(g):
    """Grid-following, decoupled double synchronous frame PLL (Rodriguez et al. 2007), references p*/|v| and -q*/|v|."""
    # frames and plant
    g.add("Rot_v", "park_v")
    g.add("LCL", "plant")
    g.add("Rot_i", "park_i")
    # synchronisation
    g.add("DDSRF_dq", "double_frame")
    g.add("LPF1_dq", "sequence_filter", omega_c="double_frame.omega_c")
    g.add("SliceQ", "sequence_q")
    g.add("SRF_PLL", "pll")
    # open-loop power control by the filtered positive sequence
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
    g.connect("plant.e", "double_frame.in_")
    g.connect("double_frame.out", "sequence_filter.in_")
    g.connect("sequence_filter.out", "sequence_q.in_")
    g.connect("sequence_q.out", "pll.e_q")
    g.connect("sequence_filter.out", "i_ref.v")
    g.connect("plant.i_ti", "i_ref.i")
    g.connect("i_ref.out", "current.in_")
    g.connect("plant.i_ti", "minus_i.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("plant.i_ti", "decoupling.in_")
    g.connect("pll.delta_omega", "decoupling.delta_omega")
    g.connect("current.out", "plant.u_r")
    g.connect("decoupling.out", "plant.u_r")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("pll.delta", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
