"""The base of an admittance, where the measurement said what its per-unit values refer to."""

from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import Sweep


def admittance_base(fitted: Record | Sweep) -> float | None:
    """Base of the admittance in S, s_base / v_base^2; None where the bases are not known."""
    if isinstance(fitted, Sweep):
        power, voltage = fitted.s_base_va, fitted.v_base_v
    else:
        bases = fitted.settings.get("bases") or {}
        power, voltage = bases.get("s_base_va"), bases.get("v_base_v")
    return float(power) / float(voltage) ** 2 if power and voltage else None
