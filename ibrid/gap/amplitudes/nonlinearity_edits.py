"""Where a nonlinearity may act: port, kind of nonlinearity, and operating value of the signal."""

from collections.abc import Iterator, Mapping, Sequence
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
    Nonlinearity,
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
    """A nonlinearity at a port, as an edit that leaves the diagram as it is: no program holds it.

    Parameters
    ----------
    effect : str
        "" for one that has no name in the catalogue.
    channels : tuple of str
        Output channels of the diagram whose sum is minus the operating value of the port's signal;
        () where that is zero or does not matter.
    """

    nonlinearity: Nonlinearity
    port: Port
    channels: tuple[str, ...] = ()

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        """Compare by identity."""
        return self is other

    @property
    def words(self) -> str:
        """Description for reports."""
        return f"a {self.nonlinearity.name} at {self.port.words}"


def list_nonlinearity_edits(diagram: Diagram, kinds: Vocabulary) -> tuple[NonlinearityEdit, ...]:
    """List every nonlinearity that is tried in a legal diagram.

    () where that has not exactly one plant with a voltage command.
    """
    view = view_of(diagram, kinds)
    if view is None:
        return ()
    port_by_name = {port.name: port for port in ports(diagram, kinds)}
    return tuple(
        NonlinearityEdit(effect, "add", port.name, diagram, {}, {}, nonlinearity, port, channels)
        for effect, nonlinearity, port, channels in _list_places(view, port_by_name)
    )


def _list_places(
    view: View, port_by_name: Mapping[str, Port]
) -> Iterator[tuple[str, Nonlinearity, Port, tuple[str, ...]]]:
    """Yield effect, nonlinearity, port and channels, as of `NonlinearityEdit`."""
    for pll in view.draft.having(Element.PLL):
        port = port_by_name.get(f"{pll}.e_q")
        if port is not None:
            yield "pll_deadband", DEAD_ZONE, port, ()
            yield "", SATURATION, port, ()
    if view.roles.current_loop is not None:
        for pack in packs(view):
            port = port_by_name.get(f"{pack}.out")
            channels = _list_current_channels(view, pack)
            if port is not None and channels:
                for limit in (MAGNITUDE_LIMIT, D_LIMIT, Q_LIMIT):
                    yield "current_limit", limit, port, channels
                yield "", DEAD_ZONE, port, ()
    for block in view.roles.power:
        for name, port in port_by_name.items():
            if name.startswith(f"{block}.") and port.words.startswith("the measured"):
                yield "", DEAD_ZONE, port, ()
    command = port_by_name.get(view.roles.command)
    if command is not None:
        yield "", MAGNITUDE_LIMIT, command, (view.roles.command,)


def _list_current_channels(view: View, pack: str) -> tuple[str, ...]:
    """List what the current loop subtracts from the reference of a PackDQ; () where not clear."""
    draft = view.draft
    reference = view.roles.reference
    own_output = f"{pack}.out"
    if path(draft, own_output, reference) is None:
        return ()
    return tuple(
        source
        for source in draft.sources(reference)
        if source != own_output and path(draft, own_output, source) is None
    )


def operating_values(
    edit: NonlinearityEdit,
    diagram: Diagram,
    kinds: Vocabulary,
    sweep: Sweep,
    values: Mapping[str, float],
) -> np.ndarray:
    """Compute the operating value (M, 2) of the signal at the port of an edit with channels.

    An integrating current loop makes its input zero, so that the reference is minus what else
    enters there; the operating value of the voltage command is that of the plant.

    Parameters
    ----------
    sweep : Sweep
        With M operating points.
    values : mapping
        Parameter values by name.

    Raises
    ------
    IbridError
        The operating value does not follow from the plant.
    """
    wiring = wire(diagram, kinds)
    parameters = parameters_at(wiring, parameter_table(wiring, "exact"), values)
    flow = carried(wiring)
    plant = wiring.plant
    channels = [(name, axis) for name in edit.channels for axis in (0, 1)]
    by_point: list[Sequence[float] | np.ndarray] = []
    for point in sweep.points:
        pqv = point.op.pqv
        equilibrium = plant_equilibrium(
            wiring.kinds[plant], parameters[plant], *pqv, sweep.power_node
        )
        frame = controller_frame(wiring, flow, parameters, equilibrium, sweep.omega_0)
        if edit.channels == (f"{plant}.u_r",):
            by_point.append(to_frame(frame, equilibrium["u_r"]))
            continue
        unknown = [channel for channel in channels if channel not in flow.known]
        if unknown:
            raise IbridError(
                f"the operating value of {unknown[0][0]} does not follow from the plant"
            )
        signals = signals_at_rest(
            wiring, flow, parameters, equilibrium, sweep.omega_0, frame, channels
        )
        by_point.append(
            [-sum(float(signals[name, axis]) for name in edit.channels) for axis in (0, 1)]
        )
    return np.array(by_point, dtype=float)
