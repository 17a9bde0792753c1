"""Cheap physical gates: what is legal but cannot be an inverter, asked before anything is fitted."""

from ibrid.structure.violation import Violation

#: Warnings of the checker that a search takes as refusals, each a slip that a fit would only hide.
GATES = ("one_rotation", "voltage_unused", "idle_module", "coupling_unit")


def implausible(warnings: tuple[Violation, ...]) -> str:
    """Why a legal diagram is refused, in sentences; "" when it may be fitted.

    Half a frame (one rotation without the other), a terminal voltage that changes nothing, a module without a way to the
    terminal current, and a decoupling whose per-unit inductance stands for seconds (off by omega_0).
    """
    return "; ".join(str(one) for one in warnings if one.reason in GATES)
