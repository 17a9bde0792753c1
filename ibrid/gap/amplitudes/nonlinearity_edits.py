"""Where a nonlinearity may act in a model: a port, the shape, and the value at which the port's
signal rests.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ibrid.assembly.known_at_rest import carried
from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.assembly.signals_at_rest import controller_frame, signals_at_rest, to_frame
from ibrid.errors import IbridError
from ibrid.gap.amplitudes.nonlinearities import (
    D_LIMIT,
    DEAD_ZONE,
    MAGNITUDE_LIMIT,
    Q_LIMIT,
    SATURATION,
    Shape,
)
from ibrid.gap.ports.ports import Port, ports
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.paths import packs, path
from ibrid.parts.editing.practice import Insertion
from ibrid.parts.editing.view import View, view_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import wire


@dataclass(frozen=True, eq=False)
class NonlinearityEdit(Insertion):
    """One nonlinearity at one port, as an edit that leaves the diagram as it is: no program holds
    it. `effect` : "" for one that has no name in the catalogue. `resting` : output channels of the
    diagram whose sum is minus the value at rest; () where that is zero or does not matter.
    """

    shape: Shape
    port: Port
    resting: tuple[str, ...] = ()

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        """A place is itself alone."""
        return self is other

    @property
    def words(self) -> str:
        """For people."""
        return f"a {self.shape.name} at {self.port.words}"


def list_nonlinearity_edits(diagram: Diagram, kinds: Vocabulary) -> tuple[NonlinearityEdit, ...]:
    """Every nonlinearity that is tried in a legal diagram; () where there is not one plant with a
    command.
    """
    view = view_of(diagram, kinds)
    if view is None:
        return ()
    found = {one.name: one for one in ports(diagram, kinds)}
    return tuple(
        NonlinearityEdit(effect, "add", port.name, diagram, {}, {}, shape, port, resting)
        for effect, shape, port, resting in _list_places(view, found)
    )


def _list_places(
    view: View, by_name: Mapping[str, Port]
) -> Iterator[tuple[str, Shape, Port, tuple[str, ...]]]:
    for pll in view.draft.having(Element.PLL):
        port = by_name.get(f"{pll}.e_q")
        if port is not None:
            yield "pll_deadband", DEAD_ZONE, port, ()
            yield "", SATURATION, port, ()
    if view.roles.current_loop is not None:
        for pack in packs(view):
            port, others = by_name.get(f"{pack}.out"), _current_channels(view, pack)
            if port is not None and others:
                for shape in (MAGNITUDE_LIMIT, D_LIMIT, Q_LIMIT):
                    yield "current_limit", shape, port, others
                yield "", DEAD_ZONE, port, ()
    for block in view.roles.power:
        for name, port in by_name.items():
            if name.startswith(f"{block}.") and port.words.startswith("the measured"):
                yield "", DEAD_ZONE, port, ()
    command = by_name.get(view.roles.command)
    if command is not None:
        yield "", MAGNITUDE_LIMIT, command, (view.roles.command,)


def _current_channels(view: View, pack: str) -> tuple[str, ...]:
    """What the current loop subtracts from the reference of a PackDQ; () where that is not
    clear.
    """
    draft, reference = view.draft, view.roles.reference
    if path(draft, f"{pack}.out", reference) is None:
        return ()
    return tuple(
        one
        for one in draft.sources(reference)
        if one != f"{pack}.out" and path(draft, f"{pack}.out", one) is None
    )


def values_at_rest(
    place: NonlinearityEdit,
    diagram: Diagram,
    kinds: Vocabulary,
    sweep: Sweep,
    values: Mapping[str, float],
) -> np.ndarray:
    """(M, 2) the port's operating value at each operating point, at parameter values by name; for a
    place with `resting`.

    An integrating current loop makes its input zero, so the reference is minus what else enters
    there; the command at rest is that of the plant. Raises IbridError where it does not follow from
    the plant.
    """
    wiring = wire(diagram, kinds)
    parameters = parameters_at(wiring, parameter_table(wiring, "exact"), values)
    flow = carried(wiring)
    at_rest = []
    for point in sweep.points:
        op = point.op.pqv
        plant = wiring.plant
        in_grid = plant_equilibrium(wiring.kinds[plant], parameters[plant], *op, sweep.power_node)
        frame = controller_frame(wiring, flow, parameters, in_grid, sweep.omega_0)
        if place.resting == (f"{plant}.u_r",):
            at_rest.append(to_frame(frame, in_grid["u_r"]))
            continue
        channels = [(name, axis) for name in place.resting for axis in (0, 1)]
        if unknown := [channel for channel in channels if channel not in flow.known]:
            raise IbridError(
                f"the operating value of {unknown[0][0]} does not follow from the plant"
            )
        signals = signals_at_rest(wiring, flow, parameters, in_grid, sweep.omega_0, frame, channels)
        at_rest.append(
            [-sum(float(signals[name, axis]) for name in place.resting) for axis in (0, 1)]
        )
    return np.array(at_rest, dtype=float)
