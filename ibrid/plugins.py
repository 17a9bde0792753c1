"""Kinds, effects, proposers and commands of other packages, found by their entry points and loaded
when they are asked for.

    [project.entry-points."ibrid.kinds"]
    lag = "ibrid_lag:LAG"                # a ModuleKind, or a tuple of them: joins the extended vocabulary
    [project.entry-points."ibrid.effects"]
    stiction = "ibrid_lag:STICTION"      # an Effect, or a tuple of them: joins the catalogue
    [project.entry-points."ibrid.proposers"]
    delays = "ibrid_lag:Delays"          # called, gives a proposer: known under this name
    [project.entry-points."ibrid.commands"]
    search = "ibrid_search.commands"     # the package whose files run commands, as "search:starting.run" in commands.toml

The command line takes them by itself; in Python they are arguments, as one's own declarations are:
`evaluate(..., vocabulary=extended_vocabulary())`, `find_gap(..., catalogue=extended_catalogue())`.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, TypeVar

from ibrid.errors import IbridError

if TYPE_CHECKING:
    from ibrid.modules.vocabulary import Vocabulary
    from ibrid.parts.catalogue import Catalogue

KINDS, EFFECTS, PROPOSERS, COMMANDS = (
    "ibrid.kinds",
    "ibrid.effects",
    "ibrid.proposers",
    "ibrid.commands",
)
Declared = TypeVar("Declared")


def _warn(sentence: str) -> None:
    warnings.warn(sentence, stacklevel=4)


def extended_vocabulary(tell: Callable[[str], None] = _warn) -> "Vocabulary":
    """The extended vocabulary and the kinds of plug-ins.

    tell : gets a sentence about each plug-in that is left out.
    """
    from ibrid.modules.kind import ModuleKind
    from ibrid.modules.vocabulary import VOCABULARY

    return _joined(KINDS, VOCABULARY, ModuleKind, lambda kind: kind.name, tell)


def extended_catalogue(tell: Callable[[str], None] = _warn) -> "Catalogue":
    """The catalogue of effects and the effects of plug-ins.

    tell : gets a sentence about each plug-in that is left out.
    """
    from ibrid.parts.catalogue import CATALOGUE
    from ibrid.parts.editing.practice import Effect

    return _joined(EFFECTS, CATALOGUE, Effect, lambda effect: effect.id, tell)


def plugin_proposers() -> Mapping[str, Callable[..., Any]]:
    """Name -> what makes the proposer of a plug-in; nothing is loaded before it is called.

    Calling raises IbridError, which names the distribution, where the plug-in cannot be loaded or
    made.
    """
    return {entry.name: partial(_made, entry) for entry in _entries(PROPOSERS)}


def command(place: str) -> Callable[..., Any]:
    """The function at a place "file.function" of `ibrid.commands`, or "package:file.function" of
    another package's commands.

    Raises IbridError where no such package is installed.
    """
    package, _, within = place.rpartition(":")
    file, _, function = within.partition(".")
    home = _home(package) if package else "ibrid.commands"
    return getattr(import_module(f"{home}.{file}"), function)


def _home(package: str) -> str:
    entry_point = next((entry for entry in _entries(COMMANDS) if entry.name == package), None)
    if entry_point is None:
        raise IbridError(
            f"this needs the package {package} of ibrid, which is not installed; install ibrid "
            "again"
        )
    return entry_point.module


def listed_plugins() -> tuple[str, ...]:
    """A line for each plug-in: its distribution, and what it brings. Nothing is loaded."""
    what = {KINDS: "kinds", EFFECTS: "effects", PROPOSERS: "proposer"}
    return tuple(
        f"{_origin(entry)}: {word} {entry.name}"
        for group, word in what.items()
        for entry in _entries(group)
    )


def _entries(group: str) -> list[EntryPoint]:
    return sorted(entry_points(group=group), key=lambda entry: (_origin(entry), entry.name))


def _origin(entry: EntryPoint) -> str:
    """Name and version of the distribution."""
    return (
        "an unknown distribution"
        if entry.dist is None
        else f"{entry.dist.name} {entry.dist.version}"
    )


def _made(entry: EntryPoint, *arguments: Any, **options: Any) -> Any:
    try:
        return entry.load()(*arguments, **options)
    except IbridError:
        raise  # a sentence already: an option that is wrong, an extra that is missing
    except Exception as error:  # other people's code: anything may go wrong in it
        raise IbridError(_complaint(entry, f"{type(error).__name__}: {error}")) from error


def _joined(
    group: str,
    shipped: tuple[Declared, ...],
    wanted: type[Declared],
    name_of: Callable[[Declared], str],
    tell: Callable[[str], None],
) -> tuple[Declared, ...]:
    """What ships, then what the plug-ins of a group bring under names of their own."""
    owners = {name_of(value): "ibrid" for value in shipped}
    joined = list(shipped)
    for entry in _entries(group):
        try:
            loaded = entry.load()
            values = list(loaded) if isinstance(loaded, Iterable) else [loaded]
            if strange := [
                type(value).__name__ for value in values if not isinstance(value, wanted)
            ]:
                raise TypeError(f"must be {wanted.__name__} or a tuple of them, found {strange[0]}")
        except Exception as error:  # other people's code: anything may go wrong in it
            tell(_complaint(entry, f"{type(error).__name__}: {error}"))
            continue
        for value in values:
            if (name := name_of(value)) in owners:
                tell(_complaint(entry, f"{owners[name]} has {name} already"))
                continue
            owners[name] = _origin(entry)
            joined.append(value)
    return tuple(joined)


def _complaint(entry: EntryPoint, reason: str) -> str:
    return (
        f"the plug-in {entry.name} of {_origin(entry)} is left out, "
        f"{' '.join(reason.split())[:300]}; mend or uninstall it"
    )
