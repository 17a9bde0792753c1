"""Which free parameters share a value while an edit is being read, and which more may."""

from collections.abc import Iterator, Sequence

from ibrid.modules.kind import ModuleKind
from ibrid_policy.numbering import Slot


class Sharing:
    """`owners` : free parameter -> the one whose value it takes, itself for its own. kinds : of all
    modules, those that are gone too, which own nothing.
    """

    def __init__(self, owners: dict[Slot, Slot], kinds: Sequence[ModuleKind]) -> None:
        self.owners, self.kinds = owners, kinds

    def free(self, number: int) -> list[str]:
        """The free parameters of a module."""
        return [name for name in self.kinds[number].parameters if (number, name) in self.owners]

    def foreign(self, slot: Slot) -> bool:
        """True for a parameter that takes another one's value."""
        return self.owners.get(slot, slot) != slot

    def borrows(self, number: int) -> bool:
        """True for a module with such a parameter."""
        return any(self.foreign((number, name)) for name in self.kinds[number].parameters)

    def lenders(self, number: int) -> Iterator[int]:
        """Earlier modules of the same kind all of whose values a module may take, and does not
        yet.
        """
        names = self.free(number)
        if not names or names != list(self.kinds[number].parameters):
            return
        for other in range(number):
            alike = self.kinds[other].name == self.kinds[number].name and self.free(other) == names
            if alike and any(
                self.owners[number, name] != self.owners[other, name] for name in names
            ):
                yield other

    def lent(self, other: int, slot: Slot) -> list[str]:
        """Parameters of a module, of the same unit, whose value this one may take, and does not
        yet.
        """
        unit, boxes = self.kinds[slot[0]].parameters[slot[1]].unit, self.kinds[other].parameters
        return [
            name
            for name in self.free(other)
            if boxes[name].unit == unit and self.owners[other, name] != self.owners[slot]
        ]

    def tied(self, number: int) -> list[str]:
        """Parameters of a module that may take the value of an earlier one."""
        return [
            name
            for name in self.free(number)
            if any(self.lent(other, (number, name)) for other in range(number))
        ]
