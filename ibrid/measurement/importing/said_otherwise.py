"""Where what the user says of a table wins over what stands in it, and the two differ: a remark for each."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ibrid.measurement.importing.column_words import unit_of
from ibrid.measurement.importing.import_account import Account, number_said

#: How near numbers must be that say the same, as a part and per unit: as near as tables are printed.
SAME = 1e-3
_WORDS = ("current", "q_axis", "voltage_axis", "power_node")


def mind_beside(where: str, beside: Mapping[str, Any], account: Account) -> None:
    """Remark on f0, directions and unit that comments, names or single variables of a file say otherwise than the user."""
    said = {key: value for key, value in account.said.items() if value is not None and beside.get(key) is not None}
    for key in (key for key in _WORDS if key in said and said[key] != beside[key]):
        account.remark(f"{key}: {said[key]} as said, while {where} says {beside[key]}")
    if "unit" in said and unit_of(str(said["unit"]).partition(":")[0]) != unit_of(str(beside["unit"])):
        account.remark(f"unit: {said['unit']} as said, while {where} says {beside['unit']}")
    if "f0_hz" in said:
        hertz, stands = (number_said(value) or 0.0 for value in (said["f0_hz"], beside["f0_hz"]))
        if not np.isclose(hertz, stands, rtol=SAME):
            account.remark(f"f0_hz: {hertz:g} as said, while {where} says {stands:g}")


def mind_power(
    role: str,
    where: str,
    name: str,
    said: np.ndarray,
    stands: np.ndarray,
    shown: np.ndarray,
    unit: str,
    account: Account,
) -> None:
    """Remark on p, q or v of which a table says another value than the user.

    Parameters
    ----------
    said, stands : (n,) per unit; NaN where nobody knows what that is per unit, which is no agreement.
    shown, unit : (n,) numbers as they are written, NaN in empty cells; and their unit, "" where it is part of the name.
    """
    whole = np.isfinite(shown)
    if not whole.any() or np.allclose(said[whole], stands[whole], rtol=SAME, atol=SAME):
        return
    low, high = (f"{end:.4g}" for end in (shown[whole].min(), shown[whole].max()))
    span = low if low == high else f"{low} to {high}"
    account.remark(f"{role}: {said[whole][0]:.4g} as said, while {where} says {f'{span} {unit}'.strip()} in {name}")
