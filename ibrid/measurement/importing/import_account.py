"""What is said about a foreign table, what was found out, and what must be asked; a question is asked once."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ibrid.errors import SweepError
from ibrid.measurement.importing.told import base_of


@dataclass(frozen=True)
class ImportQuestion:
    """What nobody has said: `sentence` begins "the unit of ..", `answers` are the likely options."""

    sentence: str
    answers: tuple[str, ...]


@dataclass(frozen=True)
class SaidPoint:
    """What `--op` says of one of several operating points. `name` : "" for that in its place. `powers` : p, q, v as (number,
    "power" in W or var, or "per unit")."""

    name: str
    powers: dict[str, tuple[float, str]]


@dataclass(eq=False)
class Account:
    """What is said, and what is found out on the way. What one answer settles is asked once. `points` : operating points that
    the user tells apart."""

    maps: tuple[str, ...]
    said: dict[str, Any]
    readings: list[tuple[str, str, str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    questions: dict[tuple[str, ...], ImportQuestion] = field(default_factory=dict)
    points: tuple[SaidPoint, ...] = ()

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
        account.ask("the inverter's base", "--base S_VA,V_LL (such as 10kVA,400V)")
        return None
    return power, voltage


def known_number(key: str, told: Mapping[str, Any], account: Account) -> float | None:
    value = number_said(told.get(key))
    if value is None:
        account.ask("the nominal frequency of the grid", "--f0-hz 50", "--f0-hz 60")
    return value


def number_said(value: Any) -> float | None:
    """A number that was said, perhaps with its dimension."""
    if value is None:
        return None
    try:
        return float(value[0] if isinstance(value, tuple) else value)
    except ValueError:
        raise SweepError(f"what is said about a table must be a number there; found {str(value)[:40]!r}.") from None
