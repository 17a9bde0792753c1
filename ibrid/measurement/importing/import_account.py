"""What is said about a foreign table, what was found out, and what must be asked; a question is
asked once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.importing.column_words import unit_of
from ibrid.measurement.importing.told import base_in_words, base_of

#: How near numbers must be that say the same, as a part and per unit: as near as tables are
#: printed.
SAME = 1e-3
#: What is said of a file in words.
_WORDS = ("current", "q_axis", "voltage_axis", "power_node")


@dataclass(frozen=True)
class ImportQuestion:
    """What nobody has said: `sentence` begins "the unit of ..", `answers` are the likely
    options.
    """

    sentence: str
    answers: tuple[str, ...]


@dataclass(frozen=True)
class SaidPoint:
    """What `--op` says of one of several operating points.

    `name` : "" for that in its place. `powers` : p, q, v as (number, "power" in W or var, or "per
    unit").
    """

    name: str
    powers: dict[str, tuple[float, str]]


@dataclass(eq=False)
class Account:
    """What is said, and what is found out on the way.

    What one answer settles is asked once. `points` : operating points that the user tells apart.
    `decibels` : whether magnitudes without a unit are taken as dB -> the first table of which.
    """

    maps: tuple[str, ...]
    said: dict[str, Any]
    readings: list[tuple[str, str, str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    questions: dict[tuple[str, ...], ImportQuestion] = field(default_factory=dict)
    points: tuple[SaidPoint, ...] = ()
    decibels: dict[bool, str] = field(default_factory=dict)

    def ask(self, sentence: str, *answers: str) -> None:
        self.questions.setdefault(answers, ImportQuestion(sentence, answers))

    def remark(self, words: str) -> None:
        if words not in self.remarks:
            self.remarks.append(words)

    def read(self, role: str, source: str, unit: str) -> None:
        if (role, source, unit) not in self.readings:
            self.readings.append((role, source, unit))


def bases_of(told: Mapping[str, Any], account: Account) -> tuple[float, float] | None:
    """VA and V of the inverter's per unit; asked for where they are needed and not said."""
    if told.get("base"):
        return base_of(str(told["base"]), "--base")
    power, voltage = (number_said(told.get(key)) for key in ("s_base_va", "v_base_v"))
    if power is None or voltage is None:
        rating = base_in_words(*base_beside(told))
        example = rating if "," in rating else "S_VA,V_LL (such as 10kVA,400V)"
        account.ask("the inverter's base", f"--base {example}")
        return None
    return power, voltage


def base_beside(told: Mapping[str, Any]) -> list[float | None]:
    """VA and V of the base that a file states, else of the rating in its words."""
    keys = (("s_base_va", "rating_va"), ("v_base_v", "rating_v"))
    return [number_said(told.get(key) or told.get(other)) for key, other in keys]


def number_said(value: Any) -> float | None:
    """A number that was said, perhaps with its dimension."""
    if value is None:
        return None
    try:
        return float(value[0] if isinstance(value, tuple) else value)
    except ValueError:
        raise SweepError(
            f"what is said about a table must be a number there; found {str(value)[:40]!r}."
        ) from None


def mind_beside(where: str, beside: Mapping[str, Any], account: Account) -> None:
    """Remark on f0, directions and unit that comments, names or single variables of a file say
    otherwise than the user.
    """
    said = {
        key: value
        for key, value in account.said.items()
        if value is not None and beside.get(key) is not None
    }
    for key in (key for key in _WORDS if key in said and said[key] != beside[key]):
        account.remark(f"{key}: {said[key]} as said, while {where} says {beside[key]}")
    if "unit" in said and unit_of(str(said["unit"]).partition(":")[0]) != unit_of(
        str(beside["unit"])
    ):
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
    said, stands : (n,) per unit; NaN where nobody knows what that is per unit, which is no
    agreement.
    shown, unit : (n,) numbers as they are written, NaN in empty cells; and their unit, "" where it
    is part of the name.
    """
    whole = np.isfinite(shown)
    if not whole.any() or np.allclose(said[whole], stands[whole], rtol=SAME, atol=SAME):
        return
    low, high = (f"{end:.4g}" for end in (shown[whole].min(), shown[whole].max()))
    span = low if low == high else f"{low} to {high}"
    account.remark(
        f"{role}: {said[whole][0]:.4g} as said, while {where} says {f'{span} {unit}'.strip()} in "
        f"{name}"
    )
