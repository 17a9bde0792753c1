"""Units of p, q and v that a table does not say: one power of two, and which voltage v is."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ibrid.measurement.importing.column_map import Source
from ibrid.measurement.importing.import_account import Account, bases_of
from ibrid.measurement.importing.timed.voltage_kinds import KINDS

#: p and q above this are no per unit.
LARGEST_PU = 3.0
#: Voltages of a phase -> the unit that says so; and how near to it v must be, as a part.
_OF_A_PHASE = {"of a phase, rms": "V_LN", "of a phase, peak": "V_peak"}
_NEAR_VOLTS = 0.03


def ask_units_of_powers(
    power: Mapping[str, tuple[np.ndarray, str]], sources: Mapping[str, Source], account: Account
) -> None:
    """Ask for the unit of p or q where the other has one."""
    for role, other in ("pq", "qp"):
        values, dimension = power[role]
        source = sources.get(role)
        if dimension or power[other][1] != "power" or source is None or not source.columns:
            continue
        largest = np.nanmax(np.abs(values), initial=0.0)
        if 0 < largest <= LARGEST_PU and account.said.get(role) is None:
            place = f"--map {role}={source.columns[0]}"
            units = ("kW", "MW") if role == "p" else ("kvar", "Mvar")
            account.ask(f"the unit of {role}", *(f"{place}[{unit}]" for unit in (*units, "pu")))


def ask_which_voltage(
    values: np.ndarray, place: str, told: Mapping[str, Any], account: Account
) -> None:
    """Ask for the kind of a voltage in V that is not near the base, but near it as the rms or peak
    value of a phase.
    """
    bases = bases_of(told, account)
    per_base = float(np.nanmedian(values)) / (bases[1] if bases else 1.0)
    for kind, unit in _OF_A_PHASE.items():
        if bases and abs(per_base / KINDS[kind] - 1) < _NEAR_VOLTS:
            account.ask(
                f"which voltage v is ({per_base:.3g} of the base)",
                f'--map "{place}[V_LL]" (between the phases, rms)',
                f'--map "{place}[{unit}]"',
            )
