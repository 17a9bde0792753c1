"""One module of a diagram with its numbers, ready to move in absolute quantities."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ibrid.assembly.interconnection import state_names
from ibrid.assembly.operating_point import Pair
from ibrid.modules.delay import pade_state_space
from ibrid.modules.kind import EQUILIBRIUM, Matrices, ModuleKind
from ibrid.modules.large_signal import Motion, asked, motion


@dataclass(frozen=True)
class Module:
    """One module of a diagram, ready to move.

    `arguments` : parameters and what the law takes from the operating point. `pade_order` : of a
    delay.
    """

    name: str
    kind: ModuleKind
    arguments: Mapping[str, Any]
    pade_order: int | None = None

    @property
    def states(self) -> list[str]:
        """Names of its states."""
        return state_names(self.kind, 2 * (self.pade_order or 0))

    def matrices(self, arguments: Mapping[str, Any]) -> Matrices | None:
        """The Pade form of a delay; None: the kind's own."""
        if self.pade_order is None or self.kind.delay is None:
            return None
        return pade_state_space(arguments[self.kind.delay], self.pade_order)

    def motion(
        self, x: Any, inputs: Mapping[str, Any], arguments: Mapping[str, Any] | None = None
    ) -> Motion:
        """(dx/dt, outputs) at absolute states and inputs, with other arguments where given."""
        arguments = self.arguments if arguments is None else arguments
        return motion(self.kind, x, inputs, arguments, self.matrices(arguments))

    @property
    def matrices_at_rest(self) -> tuple[Any, Any]:
        """(A, B) of a linear module; of a delay those of a second, which rest at the same
        states.
        """
        if self.pade_order is not None:
            return pade_state_space(1.0, self.pade_order)[:2]
        return self.kind.matrices(**self.arguments)[:2]


def module_at(
    name: str,
    kind: ModuleKind,
    parameters: Mapping[str, float],
    omega_0: float,
    ports: Mapping[str, Pair],
    pade_order: int | None,
) -> Module:
    """A module with what its law asks for; `ports` : port -> operating point."""
    known = {
        **parameters,
        "omega_0": omega_0,
        **{f"{port}{EQUILIBRIUM}": z for port, z in ports.items()},
    }
    law = kind.state_space if kind.large_signal is None else kind.large_signal.law
    return Module(name, kind, asked(law, known), pade_order)


def by_port(kind: ModuleKind, channels: Any) -> dict[str, Any]:
    """port -> scalar or pair, from the channels of a kind's inputs in order."""
    inputs: dict[str, Any] = {}
    rest_of = iter(channels)
    for port, signal in kind.inputs.items():
        inputs[port] = next(rest_of) if signal.width == 1 else (next(rest_of), next(rest_of))
    return inputs
