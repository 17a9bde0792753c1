"""What a block of a generic model declares: its name in planning files, its flags, and its
constants in the order of a .dyr record.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibrid.errors import IbridError, near

#: How a constant is found: `fitted` by least squares; `scanned`, a threshold on which the answer
#: depends in steps; `kept` at its value, since no terminal recording shows it.
Way = Literal["fitted", "scanned", "kept"]


@dataclass(frozen=True)
class Constant:
    """One number of a block.

    `typical` : where nobody says another. `low`, `high` : between which it is fitted; outside of
    them a file is warned of.
    """

    name: str
    typical: float
    low: float
    high: float
    meaning: str
    way: Way = "kept"


@dataclass(frozen=True)
class Flag:
    """A switch of a block.

    `choices` : values; those beside `typical` are tried where `tried`. `loop` : whether it chooses
    a control loop, so that its choices are tried together with those of others that do.
    """

    name: str
    typical: int
    choices: tuple[int, ...]
    meaning: str
    tried: bool = True
    loop: bool = False


@dataclass(frozen=True)
class LawBlock:
    """`name` as WECC writes it; `dyr` in PSS/E's files. `places` : integers ahead of the flags that
    say where it is connected, not what it does.
    """

    name: str
    dyr: str
    flags: tuple[Flag, ...]
    constants: tuple[Constant, ...]
    reference: str
    places: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Flags, then constants, as in a record."""
        return (
            *(flag.name for flag in self.flags),
            *(constant.name for constant in self.constants),
        )

    @property
    def typical(self) -> dict[str, float]:
        """Name -> value, flags among them."""
        flags = {flag.name: float(flag.typical) for flag in self.flags}
        return flags | {constant.name: constant.typical for constant in self.constants}

    def constant(self, name: str) -> Constant:
        """The constant of that name; IbridError, with the near names, where there is none."""
        for constant in self.constants:
            if constant.name == name:
                return constant
        known = [constant.name for constant in self.constants]
        raise IbridError(f"{self.name} has no constant {name!r}; {near(name, known)}")

    def values(self, given: Mapping[str, float]) -> tuple[float, ...]:
        """Values in the order of a record; typical ones where `given` has none."""
        whole = self.typical | dict(given)
        return tuple(float(whole[name]) for name in self.names)

    def record(self, given: Mapping[str, float]) -> np.record:
        """The same with names, as machine code takes them: `record.Tg`."""
        form = np.dtype([(name, float) for name in self.names])
        return np.rec.array([self.values(given)], dtype=form)[0]
