"""One breach of the grammar, as a sentence with its line and what would mend it."""

from collections.abc import Iterable
from dataclasses import dataclass

from ibrid.errors import near

#: So many known names are compared for one program, then no near ones are named; a hostile text may
#: hold a thousand breaches.
COMPARED = 600


@dataclass(frozen=True)
class Violation:
    """`line` : of the program, None for a diagram made in Python.

    `reason` : a short name that stays, for counting.
    """

    line: int | None
    message: str
    reason: str

    def __str__(self) -> str:
        return self.message if self.line is None else f"line {self.line}: {self.message}"


class Violations:
    """Collects violations while a diagram is read."""

    def __init__(self) -> None:
        self._found: list[Violation] = []
        self._compared = 0

    def add(self, line: int | None, reason: str, message: str) -> None:
        self._found.append(Violation(line, message, reason))

    def __bool__(self) -> bool:
        return bool(self._found)

    @property
    def sorted(self) -> tuple[Violation, ...]:
        """By line, those without a line last; within a line in the order in which they were
        found.
        """
        return tuple(sorted(self._found, key=lambda one: (one.line is None, one.line or 0)))

    def near(self, name: str, known: Iterable[str]) -> str:
        """`errors.near`, with an end to the work."""
        names = tuple(known)
        self._compared += len(names)
        return (
            near(name[:64], names) if self._compared <= COMPARED else "mend the names above first"
        )


def shown(name: str) -> str:
    """A name quoted, cut where it is absurdly long."""
    return repr(name if len(name) <= 64 else name[:61] + "...")


def first_line(line: int | None) -> str:
    """Where the first of two was, as a clause."""
    return "" if line is None else f", first in line {line}"
