"""The controller in program text: outer loops, current loop, and what adds to the voltage
command.
"""

from ibrid_bench.hidden.parameters import Device
from ibrid_bench.hidden.program_lines import Lines


def power_loops(lines: Lines, device: Device, omega_0: float) -> None:
    """From p and q, or what stands in their place, to the current reference."""
    m = device
    loops = {"d": ("p", m.p_loop, m.kP_p, m.kI_p), "q": ("q", m.q_loop, m.kP_q, m.kI_q)}
    if m.p_loop == "none" and m.q_loop == "none":
        return
    shared = m.p_loop == m.q_loop and (m.kP_p, m.kI_p) == (m.kP_q, m.kI_q)
    if "power" in (m.p_loop, m.q_loop):
        lines.add("PQ_calc", "power")
        lines.chain("plant.e", "power.e")
        lines.chain("plant.i_g", "power.i")
    for axis, (name, kind, kP, kI) in loops.items():
        if kind == "none":
            lines.add("ConstZero", f"no_{name}")
            lines.chain(f"no_{name}.out", f"i_ref.in_{axis}")
            continue
        loop = "v_loop" if kind == "voltage" else f"{name}_loop"
        lines.add("PI", loop, owner="power" if shared else "", kP=kP, kI=kI)
        lines.chain(
            *_measured(lines, device, name, kind), f"{loop}.in_", f"{loop}.out", f"i_ref.in_{axis}"
        )
    lines.add("PackDQ", "i_ref")
    lines.chain("i_ref.out", "current.in_")
    _droop(lines, device, omega_0)


def _measured(lines: Lines, device: Device, name: str, kind: str) -> list[str]:
    """The path to the controller of p or q, or of what stands in their place; with the sign that
    the loop asks for.
    """
    if kind == "voltage":
        lines.add("Magnitude", "e_size")
        return ["plant.e", "e_size.in_", "e_size.out"]
    if kind == "dc_link":
        lines.add("DC_link", "dc_link", C_dc=device.C_dc)
        lines.chain(_current(device), "dc_link.i")
        return ["dc_link.v_dc"]
    path = [f"power.{name}"]
    if device.omega_c_power is not None:
        filtered = f"{name}_filter"
        lines.add("LPF1", filtered, owner="power_filter", omega_c=device.omega_c_power)
        path += [f"{filtered}.in_", f"{filtered}.out"]
    if name == "p":
        lines.add("Negate", "minus_p")
        path += ["minus_p.in_", "minus_p.out"]
    return path


def _droop(lines: Lines, device: Device, omega_0: float) -> None:
    m = device
    if m.k_droop is None or m.p_loop != "power":
        return
    path = ["pll.delta_omega"]
    if m.omega_c_droop is not None:
        lines.add("LPF1", "droop_filter", omega_c=m.omega_c_droop)
        path += ["droop_filter.in_", "droop_filter.out"]
    lines.add("Gain", "droop", k=-m.k_droop / omega_0)
    lines.chain(*path, "droop.in_", "droop.out", "p_loop.in_")


def current_loop(lines: Lines, device: Device, omega_0: float) -> None:
    """From the current reference to the plant, with decoupling and delay."""
    m, command = device, _command(device)
    raw = looped = decoupled = _current(device)
    if m.omega_c_current is not None:
        lines.add("LPF1_dq", "current_filter", omega_c=m.omega_c_current)
        lines.chain(raw, "current_filter.in_")
        looped = "current_filter.out"
        decoupled = looped if m.current_filter == "both" else raw
    lines.add("Negate_dq", "minus_i")
    lines.add("PI_dq", "current", kP=m.kP_current, kI=m.kI_current)
    lines.chain(looped, "minus_i.in_", "minus_i.out", "current.in_", "current.out", command)
    if m.decoupling == "nominal":
        lines.add("JMul", "decoupling", L=(m.L_decoupling or 0.0) / omega_0)  # counted in seconds
        lines.chain(decoupled, "decoupling.in_", "decoupling.out", command)
    elif m.decoupling == "pll":
        lines.add("JMul_omega", "decoupling", L=m.L_decoupling)
        lines.chain(decoupled, "decoupling.in_", "decoupling.out", command)
        lines.chain("pll.delta_omega", "decoupling.delta_omega")
    if m.T_d:
        lines.add("Delay", "delay", T_d=m.T_d)
        lines.chain("delay.out", "delay_angle.in_" if m.delay_angle is not None else "plant.u_r")
    if m.delay_angle is not None:
        lines.add("Turn", "delay_angle", phi=m.delay_angle)
        lines.chain("delay_angle.out", "plant.u_r")
    if m.D_dead_time is not None:
        lines.add("DeadTime", "dead_time", D=m.D_dead_time, a=m.a_dead_time)
        lines.chain(_current(device), "dead_time.i", "dead_time.out", "plant.u_r")


def additions(lines: Lines, device: Device, omega_0: float) -> None:
    """What adds to the command beside the loop; at last the converter's power where a DC link
    balances it.
    """
    m, command = device, _command(device)
    _feedforward(lines, device)
    if m.k_damping is not None:
        lines.add("Gain_dq", "damping", k=-m.k_damping)
        lines.chain("plant.i_C", "damping.in_", "damping.out", command)
        if m.omega_c_damping is not None:
            lines.add("LPF1_dq", "damping_filter", omega_c=m.omega_c_damping)
            lines.add("Negate_dq", "minus_slow")
            lines.chain("plant.i_C", "damping_filter.in_", "damping_filter.out", "minus_slow.in_")
            lines.chain("minus_slow.out", "damping.in_")
    if m.R_virtual is not None:
        subtracted_from = command if m.virtual_impedance == "command" else "current.in_"
        lines.add("Negate_dq", "minus_i_g")
        lines.add("Gain_dq", "virtual_resistance", k=m.R_virtual)
        lines.add("JMul", "virtual_reactance", L=(m.X_virtual or 0.0) / omega_0)
        lines.chain("plant.i_g", "minus_i_g.in_", "minus_i_g.out", "virtual_resistance.in_")
        lines.chain("virtual_resistance.out", subtracted_from)
        lines.chain(
            "minus_i_g.out", "virtual_reactance.in_", "virtual_reactance.out", subtracted_from
        )
    if m.k_resonant is not None:
        multiple = (m.omega_resonant or 0.0) / omega_0
        lines.add("Resonant_dq", "resonant", k=m.k_resonant, omega_c=m.width_resonant, n=multiple)
        for source in lines.sources("current.in_"):
            lines.chain(source, "resonant.in_")
        lines.chain("resonant.out", command)
    if m.p_loop == "dc_link":
        for source in lines.sources("plant.u_r"):
            lines.chain(source, "dc_link.u")


def _feedforward(lines: Lines, device: Device) -> None:
    m = device
    if not m.k_ff:
        return
    path = ["plant.e"]
    if m.omega_c_ff is not None:
        lines.add("LPF1_dq", "feedforward_filter", omega_c=m.omega_c_ff)
        path += ["feedforward_filter.in_", "feedforward_filter.out"]
    if m.k_sogi is not None:
        lines.add(
            "SOGI_dq" if m.sogi_tuning == "pll" else "SOGI_fixed",
            "feedforward_sequence",
            k=m.k_sogi,
        )
        if m.sogi_tuning == "nominal":
            lines.chain("pll.delta_omega", "feedforward_sequence.delta_omega")
        path += ["feedforward_sequence.in_", "feedforward_sequence.out"]
    if m.k_ff != 1.0:
        lines.add("Gain_dq", "feedforward", k=m.k_ff)
        path += ["feedforward.in_", "feedforward.out"]
    lines.chain(*path, _command(device))


def _current(device: Device) -> str:
    return "plant.i_ti" if device.filter == "LCL" else "plant.i_g"


def _command(device: Device) -> str:
    if device.T_d:
        return "delay.in_"
    return "plant.u_r" if device.delay_angle is None else "delay_angle.in_"
