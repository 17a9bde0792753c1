"""What goes wrong, as sentences: every error names what must hold, what was found and the next
step.
"""

from collections.abc import Iterable
from difflib import get_close_matches

from ibrid.foreign_text import cut_words, show_controls


class IbridError(Exception):
    """A wrong input.

    The message is one sentence for the user; the command line prints it and exits with status 2.
    """

    def __str__(self) -> str:
        return cut_words(show_controls(super().__str__()))


class ProgramError(IbridError):
    """Program text that cannot be read."""


class DiagramError(IbridError):
    """A diagram that the grammar refuses, or a use of it that has no meaning."""


class ModuleError(IbridError):
    """A module kind whose declaration contradicts itself."""


class SweepError(IbridError):
    """Measured data that cannot be read or used."""


class ImpossibleValueError(SweepError):
    """Data that were read and that no device can have: a base or a unit was meant otherwise."""


class OperatingPointError(IbridError):
    """An operating point that does not exist or was not given."""


class UnforeseenError(IbridError):
    """Arguments that a public function cannot take, as showed in its midst: `__cause__` says where.

    The command line exits with status 1.
    """


class UnfinishedError(IbridError):
    """A limit ended the work before it was finished; what was found is kept.

    The command line exits with status 3.
    """


def near(name: object, known: Iterable[str]) -> str:
    """A clause that names the known names close to `name`, or all of them when there are few."""
    names = sorted(set(known))
    close = get_close_matches(name, names, n=3, cutoff=0.5) if isinstance(name, str) else []
    if close:
        return f"did you mean {' or '.join(close)}?"
    if len(names) <= 12:
        return f"known are: {', '.join(names)}" if names else "there is none"
    return f"there are {len(names)}, for instance {', '.join(names[:5])}"


def some(names: Iterable[str], most: int = 4) -> str:
    """The first few names as a list."""
    listed = list(names)
    return ", ".join(listed[:most]) + (
        f" and {len(listed) - most} more" if len(listed) > most else ""
    )
