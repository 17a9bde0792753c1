def build_gfm_direct_dvoc(g):
    """Grid-forming, dispatchable virtual oscillator without inner loops (Seo et al., APEC 2019)."""
    # frames and plant; the angle is the integral of the frequency
    g.add("Rot_v", "park_v")
    g.add("LFilter", "plant")
    g.add("Rot_i", "park_i")
    g.add("Integrator", "angle")
    # virtual oscillator
    g.add("dVOC", "oscillator")
    g.add("ConstZero", "no_u_q")
    g.add("PackDQ", "u_ref")
    # wiring
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("angle.out", "park_v.delta")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("oscillator.delta_omega", "plant.delta_omega")
    g.connect("oscillator.delta_omega", "angle.in_")
    g.connect("u_ref.out", "oscillator.v")
    g.connect("plant.i_g", "oscillator.i")
    g.connect("oscillator.E", "u_ref.in_d")
    g.connect("no_u_q.out", "u_ref.in_q")
    g.connect("u_ref.out", "plant.u_r")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("angle.out", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
