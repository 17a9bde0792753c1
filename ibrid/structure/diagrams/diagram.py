"""A block diagram: named modules and connections, filled by `add` and `connect` in the words of a
program.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from keyword import iskeyword
from typing import Any

from ibrid.border import methods_take_kinds
from ibrid.errors import DiagramError
from ibrid.frozen import Frozen
from ibrid.showing import shown
from ibrid.structure.network.outside import NOTHING, Outside

Binding = str | float | tuple[float, float]

#: Outer ports: the terminal voltage drives the diagram, the terminal current leaves it.
TERMINAL_VOLTAGE, TERMINAL_CURRENT = "v_DQ", "i_DQ"


_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")
_PARAMETER_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}(\.[A-Za-z_][A-Za-z0-9_]{0,63})?")


@dataclass(frozen=True)
class Instance(Frozen):
    """A named module: `kind` of the vocabulary, `name` in this diagram, `bindings` of
    parameters.
    """

    kind: str
    name: str
    bindings: Mapping[str, Binding] = field(default_factory=dict)
    line: int | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Connection:
    """`source` adds to `target`; both are "NAME.port" or an outer port."""

    source: str
    target: str
    line: int | None = field(default=None, compare=False)


@methods_take_kinds
class Diagram:
    """Named modules and connections.

    `instances`, `connections` : in the order in which they were made. `outside` : what lies between
    the terminals and the measurement. `add` and `connect` refuse what no diagram can mean (a name
    that is no name, a binding that is no number); whether the whole is legal is the question of
    `ibrid.structure.compiling.check.violations`.
    """

    def __init__(self, name: str = "build") -> None:
        if not isinstance(name, str) or not _NAME.fullmatch(name) or iskeyword(name):
            raise DiagramError(
                "a diagram's name is a word of letters, digits and underscores, none of Python's, "
                f"got {name!r:.80}"
            )
        self.name = name
        self.instances: tuple[Instance, ...] = ()
        self.connections: tuple[Connection, ...] = ()
        self.outside = NOTHING

    def add(self, kind: str, name: str, /, *, line: int | None = None, **bindings: Binding) -> None:
        """Add a module of `kind` called `name`; a binding is a shared name, a number or a pair (a
        narrower box).
        """
        for what, word in (
            ("kind", kind),
            ("name", name),
            *(("parameter", key) for key in bindings),
        ):
            if not isinstance(word, str) or not _NAME.fullmatch(word):
                raise DiagramError(
                    f"a module's {what} is a word of letters, digits and underscores (at most 64), "
                    f"got {word!r:.80}"
                )
        if name in (TERMINAL_VOLTAGE, TERMINAL_CURRENT):
            raise DiagramError(f"{name} is an outer port; give the module another name")
        checked = {key: _binding(f"{name}.{key}", value) for key, value in bindings.items()}
        self.instances += (Instance(kind, name, checked, line),)

    def connect(self, source: str, target: str, *, line: int | None = None) -> None:
        """Let `source` drive `target`; several sources of one target add up."""
        for end in (source, target):
            if not isinstance(end, str) or not _PARAMETER_NAME.fullmatch(end):
                raise DiagramError(
                    f"a connection joins NAME.port, {TERMINAL_VOLTAGE} or {TERMINAL_CURRENT}, got "
                    f"{end!r:.80}"
                )
        self.connections += (Connection(source, target, line),)

    def extend(self, instances: Iterable[Instance], connections: Iterable[Connection]) -> None:
        """Take over modules and connections of another diagram."""
        self.instances += tuple(instances)
        self.connections += tuple(connections)

    def copy(self) -> "Diagram":
        """An independent diagram with the same modules and connections."""
        other = Diagram(self.name)
        other.instances, other.connections, other.outside = (
            self.instances,
            self.connections,
            self.outside,
        )
        return other

    def behind(self, outside: Outside) -> "Diagram":
        """The same diagram behind labels and a port; they are no part of its structure, its program
        or its equality.
        """
        if outside == self.outside:
            return self
        other = self.copy()
        other.outside = outside
        return other

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Diagram):
            return NotImplemented
        return self.instances == other.instances and self.connections == other.connections

    def __repr__(self) -> str:
        return (
            f"<Diagram {self.name}: {len(self.instances)} modules, {len(self.connections)} "
            "connections>"
        )

    def plot(self, ax: Any = None) -> Any:
        """A matplotlib figure, or `ax`: the block diagram as pages draw it.

        Raises IbridError for a diagram that is empty or too large to be read.
        """
        return shown(self, "plotting", "diagram_plot", ax)

    def _repr_html_(self) -> str:
        """Drawn, for notebooks."""
        return shown(self, "pages.notebook", "diagram_html")


def _binding(where: str, value: object) -> Binding:
    if isinstance(value, str):
        if not _PARAMETER_NAME.fullmatch(value):
            raise DiagramError(
                f"{where} is bound to {value!r:.80}; a shared name is a word or two words joined "
                "by a dot"
            )
        return value
    if isinstance(value, tuple) and len(value) == 2:
        low, high = (_number(where, entry) for entry in value)
        if not low < high:
            raise DiagramError(
                f"{where} has the box ({low:g}, {high:g}); the first number must be the smaller"
            )
        return low, high
    return _number(where, value)


def _number(where: str, value: object) -> float:
    number = math.nan
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            raise DiagramError(
                f"{where} is bound to an integer too large for a number; write a finite one"
            ) from None
    if not math.isfinite(number):
        raise DiagramError(
            f"{where} is bound to {value!r:.80}; write a shared name, a finite number or a pair "
            "(low, high)"
        )
    return number
