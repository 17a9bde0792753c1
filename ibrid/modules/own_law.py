"""Calls of laws that kinds bring along: what a user's own code raises is a fault of the kind, what
ours raises is ours.
"""

from collections.abc import Callable
from typing import Any

from ibrid.errors import IbridError, ModuleError
from ibrid.interrupts import heed_interrupt

#: Characters of the first line of an error that are told.
LONGEST = 300


def call_law(kind: str, law: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Call a function that a kind declares.

    kind : its name. Raises ModuleError, one sentence, where a law that does not ship with ibrid
    raises anything, SystemExit included; an IbridError and an interrupt pass, and so does whatever
    a law of ours raises.
    """
    home = getattr(law, "__module__", None) or ""
    if home.split(".")[0] == __name__.split(".")[0]:
        return law(*arguments, **named)
    try:
        return law(*arguments, **named)
    except IbridError:
        raise
    except (Exception, SystemExit) as error:
        heed_interrupt()
        first = (str(error).strip().splitlines() or ["no message"])[0][:LONGEST]
        raise ModuleError(
            f"the law of {kind} broke off with {type(error).__name__}: {first}; mend the kind, or "
            "leave it out"
        ) from error
