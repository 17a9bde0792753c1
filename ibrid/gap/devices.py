"""A model as the effects see it, device by device: of two behind one PCC each has its own plant, frame and loops."""

from ibrid.gap.effect import Model, model_of
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.devices import devices
from ibrid.structure.diagram import Connection, Diagram
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import roles
from ibrid.structure.wiring import Wiring, wire


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
        alone = _alone(part)
        seen = roles(alone, kinds)
        if seen is not None:
            beside = frozenset(one.name for one in diagram.instances) - frozenset(part.kinds)
            found.append(Model(diagram, kinds, Draft(alone, kinds), seen, beside))
    return tuple(found)


def _alone(part: Wiring) -> Diagram:
    """The modules of a device and their connections, those to the terminals included."""
    alone = Diagram()
    wires = [Connection(source, target) for target, sources in part.sources.items() for source in sources]
    alone.extend(part.instances, wires)
    return alone
