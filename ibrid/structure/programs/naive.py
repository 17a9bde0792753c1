def build_gfl_skeleton(g):
    """The naive start of the search: a static gain on the terminal voltage feeding an L filter, no control at all."""
    g.add("LFilter", "plant")
    g.add("Gain_dq", "gain")
    g.add("ConstZero", "no_frequency")
    g.connect("v_DQ", "plant.v_in")
    g.connect("v_DQ", "gain.in_")
    g.connect("gain.out", "plant.u_r")
    g.connect("no_frequency.out", "plant.delta_omega")
    g.connect("plant.i_g", "i_DQ")
