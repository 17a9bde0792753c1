"""The program text of a block diagram that is exactly a hidden device, with its values: the model
an engineer would draw.

Names are those of the textbook programs. Text only: nothing of the program's grammar or vocabulary
is imported.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ibrid_bench.hidden.parameters import Device
from ibrid_bench.hidden.program_control import additions, current_loop, power_loops
from ibrid_bench.hidden.program_lines import Lines

from ibrid.errors import IbridError

_IN_NO_PROGRAM = (
    *(
        "load_L",
        "omega_n_ff",
        "omega_zero",
        "comb_gain",
        "k_droop_v",
        "omega_c_magnitude",
        "omega_c_reference",
    ),
    *(
        "k_reference",
        "kP_negative",
        "omega_c_command",
        "omega_c_sensor",
        "T_current",
        "T_hold",
        "L_t",
        "I_core",
    ),
)


@dataclass(frozen=True)
class BlockDiagram:
    """Program text, and the value of each of its parameters; per unit, s, rad/s."""

    text: str
    values: Mapping[str, float]


def block_diagram(device: Device, omega_0: float) -> BlockDiagram:
    """The block diagram of a device; omega_0 in rad/s.

    Raises IbridError for a device with a part that is not written here: no module stands for it, or
    it is only ever hidden.
    """
    foreign = [name for name in _IN_NO_PROGRAM if getattr(device, name) is not None]
    foreign += [name for name in ("p_loop", "q_loop") if getattr(device, name) == "reference"]
    foreign += [
        name
        for name in ("sensed_voltage", "sensed_current")
        if getattr(device, name) not in ("e", "i_ti")
    ]
    if foreign:
        raise IbridError(
            f"a device with {', '.join(foreign)} has no block diagram; leave these out of the "
            "model."
        )
    lines = Lines()
    _frames(lines, device)
    _plant(lines, device)
    _synchronisation(lines, device)
    power_loops(lines, device, omega_0)
    current_loop(lines, device, omega_0)
    additions(lines, device, omega_0)
    return BlockDiagram(lines.text("build_model"), MappingProxyType(lines.values))


def _frames(lines: Lines, device: Device) -> None:
    if device.kP_pll is None:
        lines.chain("v_DQ", "plant.v_in")
        lines.chain("plant.i_g", "i_DQ")
    else:
        lines.add("Rot_v", "park_v")
        lines.add("Rot_i", "park_i")
        lines.chain("v_DQ", "park_v.v_DQ", "park_v.v_dq", "plant.v_in")
        lines.chain("plant.i_g", "park_i.i_dq", "park_i.i_DQ", "i_DQ")
    if device.R_shunt is not None:
        lines.add("Shunt_RC", "shunt", R=device.R_shunt, C=device.C_shunt)
        lines.chain("v_DQ", "shunt.v", "shunt.i", "i_DQ")


def _plant(lines: Lines, device: Device) -> None:
    m = device
    own: dict[str, Any] = {"L_F": m.L_F, "R_F": m.R_F}
    behind: dict[str, Any] = {"L_g": m.L_g + m.L_series, "R_g": m.R_g + m.R_series}
    if m.filter == "L":
        if m.L_series:
            lines.add("LLFilter", "plant", **own, **behind)
        else:
            lines.add("LFilter", "plant", **own)
        return
    own |= {"C_F": m.C_F or 0.0, **behind}
    if m.R_branch is not None:
        if m.R_C:
            raise IbridError(
                "a device with R_C and a further branch at the capacitor has no block diagram; "
                "drop one."
            )
        lines.add("LCL_RC", "plant", **own, R_d=m.R_branch, C_d=m.C_branch)
    elif m.R_C:
        lines.add("LCL_R", "plant", **own, R_C=m.R_C)
    else:
        lines.add("LCL", "plant", **own)


def _synchronisation(lines: Lines, device: Device) -> None:
    m = device
    if m.kP_pll is None:
        lines.add("ConstZero", "no_frequency")
        lines.chain("no_frequency.out", "plant.delta_omega")
        return
    path = ["plant.e_q"]
    if m.k_dsogi is not None:
        lines.add(
            "DSOGI_dq" if m.sogi_tuning == "pll" else "DSOGI_fixed", "pll_sequence", k=m.k_dsogi
        )
        if m.sogi_tuning == "nominal":
            lines.chain("pll.delta_omega", "pll_sequence.delta_omega")
        lines.add("SliceQ", "pll_q")
        lines.chain("plant.e", "pll_sequence.in_", "pll_sequence.out", "pll_q.in_")
        path = ["pll_q.out"]
    if m.omega_c_pll is not None:
        lines.add("LPF1", "pll_filter", omega_c=m.omega_c_pll)
        path += ["pll_filter.in_", "pll_filter.out"]
    if m.omega_n_pll is not None:
        lines.add("Notch", "pll_notch", omega_n=m.omega_n_pll, Q=m.Q_pll)
        path += ["pll_notch.in_", "pll_notch.out"]
    lines.add("SRF_PLL", "pll", kP_pll=m.kP_pll, kI_pll=m.kI_pll)
    lines.chain(*path, "pll.e_q")
    lines.chain("pll.delta_omega", "plant.delta_omega")
    lines.chain("pll.delta", "park_v.delta")
    lines.chain("pll.delta", "park_i.delta")
