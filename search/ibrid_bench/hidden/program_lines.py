"""Program text, line by line: modules with the values of their parameters, then connections."""

from ibrid.errors import IbridError


class Lines:
    """A program while it is written.

    Module names and the values of their parameters are kept as they come.
    """

    def __init__(self) -> None:
        self._modules: list[str] = []
        self._connections: list[tuple[str, str]] = []
        self.values: dict[str, float] = {}

    def add(self, kind: str, name: str, *, owner: str = "", **values: float | None) -> None:
        """A module; with an owner its parameters are shared under that name."""
        bindings = "".join(f', {one}="{owner}.{one}"' for one in values) if owner else ""
        self._modules.append(f'g.add("{kind}", "{name}"{bindings})')
        for one, value in values.items():
            if value is None:
                raise IbridError(
                    f"{name} ({kind}) must have a value of {one}; give the device one."
                )
            self.values[f"{owner or name}.{one}"] = float(value)

    def chain(self, *ports: str) -> None:
        """Connections along a path: source, input, output of the same module, next input, ..."""
        self._connections += [(ports[k], ports[k + 1]) for k in range(0, len(ports), 2)]

    def sources(self, target: str) -> list[str]:
        """What drives an input so far."""
        return [source for source, driven in self._connections if driven == target]

    def text(self, name: str) -> str:
        """The whole program."""
        wires = [f'g.connect("{source}", "{target}")' for source, target in self._connections]
        return (
            "\n".join([f"def {name}(g):", *(f"    {line}" for line in [*self._modules, *wires])])
            + "\n"
        )
