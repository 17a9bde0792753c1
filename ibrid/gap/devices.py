"""A model as the effects see it, device by device: of two behind one PCC each has its own plant, frame and loops."""

from ibrid.gap.effect import Model, model_of
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.devices import devices
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Connection, Diagram
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import roles
from ibrid.structure.wiring import Wiring, split_port, wire


def models_of(diagram: Diagram, kinds: Vocabulary) -> tuple[Model, ...]:
    """One model for each device of a legal diagram whose plant has a command, in the order of the plants.

    Of two devices each model looks at its own modules alone, and edits the whole diagram.
    """
    parts = devices(wire(diagram, kinds))
    if len(parts) == 1:
        model = model_of(diagram, kinds)
        return () if model is None else (model,)
    found = []
    for part in parts:
        alone = _alone(diagram, part)
        seen = roles(alone, kinds)
        if seen is not None:
            beside = frozenset(one.name for one in diagram.instances) - frozenset(part.kinds)
            found.append(Model(diagram, kinds, Draft(alone, kinds), seen, beside))
    return tuple(found)


def _alone(diagram: Diagram, part: Wiring) -> Diagram:
    """The modules of a device and their connections, those to the terminals included."""

    def inside(connection: Connection) -> bool:
        ends = (connection.source, connection.target)
        return all(end in (TERMINAL_VOLTAGE, TERMINAL_CURRENT) or split_port(end)[0] in part.kinds for end in ends)

    alone = Diagram(diagram.name)
    alone.extend(part.instances, [one for one in diagram.connections if inside(one)])
    return alone
