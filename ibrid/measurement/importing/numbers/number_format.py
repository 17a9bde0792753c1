"""What is said of how the numbers of a file are written, and the file does not show."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ibrid.errors import SweepError

#: What may be said, by the names of the options.
CHOICES = {"decimal": ("point", "comma"), "polar": ("deg", "rad")}


@dataclass(frozen=True)
class NumberFormat:
    """How numbers are written; "" for what nobody says.

    decimal : "point" or "comma", the decimal mark of numbers such as 1.234 that have two readings.
    polar : "deg" or "rad", the unit of angles in polar cells that have none.
    """

    decimal: str = ""
    polar: str = ""

    @property
    def mark(self) -> str:
        """The decimal mark that is said, "" for none."""
        return {"point": ".", "comma": ","}.get(self.decimal, "")


UNSAID = NumberFormat()


def number_format(said: Mapping[str, Any]) -> NumberFormat:
    """The format among all that is said; SweepError for a word that is no choice."""
    words = {name: str(said[name]) for name in CHOICES if said.get(name) is not None}
    for name, word in words.items():
        if word not in CHOICES[name]:
            raise SweepError(f"{name} must be {' or '.join(CHOICES[name])}; found {word[:40]!r}.")
    return NumberFormat(**words)


def without_format(said: Mapping[str, Any]) -> dict[str, Any]:
    """All that is said but the format of the numbers."""
    return {name: value for name, value in said.items() if name not in CHOICES}
