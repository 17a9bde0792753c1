"""Ports of a diagram: the places at which one unknown transfer may join it, each as an edited diagram.

In series, a block 1 + Delta lies in a signal; a missing path is such a block beside -1, so that Delta alone is added.
"""

from dataclasses import dataclass

from ibrid.gap.port_kinds import PORT_KINDS
from ibrid.gap.port_places import missing_paths, places_in_series
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.edit import NotInVocabulary
from ibrid.parts.view import View, views_of
from ibrid.structure.check import violations
from ibrid.structure.diagram import Diagram


@dataclass(frozen=True)
class Port:
    """A place for one unknown transfer.

    `name` : of the place, in names of the user's program. `words` : what an engineer calls it. `diagram` : the given one
    with the block in it, of the kinds given and `PORT_KINDS`; its free parameters are those of the given one, and at
    Delta = 0 it is that, or where the port stands in place of a regulator, that without the regulator's output.
    `block` : name of the module.
    """

    name: str
    words: str
    diagram: Diagram
    block: str


def ports(diagram: Diagram, kinds: Vocabulary) -> tuple[Port, ...]:
    """Every port that a legal diagram has, device by device, each with a legal diagram; () where no plant has a command.

    Places at which an unknown transfer says exactly the same come once, but for those that an engineer tells apart.
    """
    return tuple(port for view in views_of(diagram, (*kinds, *PORT_KINDS)) for port in _ports_of(view))


def _ports_of(view: View) -> list[Port]:
    found = []
    for place in (*places_in_series(view), *missing_paths(view)):
        try:
            drawn = view.drawn(place.edit)
        except NotInVocabulary:
            continue
        if not violations(drawn.diagram, view.kinds):
            found.append(Port(place.name, place.words, drawn.diagram, drawn.result))
    return found
