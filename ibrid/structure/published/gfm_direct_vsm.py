def build_gfm_direct_vsm(g):
    """Virtual synchronous machine without inner loops: swing equation as a low-pass of p, reactive power by an integrator (Zhong 2011).
    """
    # frames and plant; the angle is the integral of the frequency
    g.add("Rot_v", "park_v")
    g.add("LCL", "plant")
    g.add("Rot_i", "park_i")
    g.add("Integrator", "angle")
    # swing equation
    g.add("PQ_calc", "power")
    g.add("Gain", "p_gain")
    g.add("LPF1", "inertia")
    # excitation: the voltage follows q and the voltage's magnitude
    g.add("Gain", "q_gain")
    g.add("Magnitude", "e_size")
    g.add("Gain", "e_gain")
    g.add("Integrator", "flux")
    g.add("ConstZero", "no_u_q")
    g.add("PackDQ", "u_ref")
    # virtual resistance
    g.add("Gain_dq", "virtual_resistance")
    # wiring
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("angle.out", "park_v.delta")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("inertia.out", "plant.delta_omega")
    g.connect("inertia.out", "angle.in_")
    g.connect("plant.e", "power.e")
    g.connect("plant.i_g", "power.i")
    g.connect("power.p", "p_gain.in_")
    g.connect("p_gain.out", "inertia.in_")
    g.connect("power.q", "q_gain.in_")
    g.connect("q_gain.out", "flux.in_")
    g.connect("plant.e", "e_size.in_")
    g.connect("e_size.out", "e_gain.in_")
    g.connect("e_gain.out", "flux.in_")
    g.connect("flux.out", "u_ref.in_d")
    g.connect("no_u_q.out", "u_ref.in_q")
    g.connect("u_ref.out", "plant.u_r")
    g.connect("plant.i_ti", "virtual_resistance.in_")
    g.connect("virtual_resistance.out", "plant.u_r")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("angle.out", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
