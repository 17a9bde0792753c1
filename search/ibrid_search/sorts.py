"""Sorts of control: what an engineer would call a diagram by, whatever its details."""

from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.view import View, views_of
from ibrid.structure.diagram import Diagram
from ibrid.structure.wiring import split_port


def sort_of_control(diagram: Diagram, kinds: Vocabulary) -> str:
    """By what the frequency follows (phase, power, oscillator, several or nothing), and whether the voltage is controlled; of
    two devices both. Empty where the roles of none can be told."""
    return " beside ".join(sorted(_sort(view) for view in views_of(diagram, kinds)))


def _sort(view: View) -> str:
    draft, roles = view.draft, view.roles
    makers = draft.upstream(f"{roles.plant}.delta_omega", without=roles.plant)
    phase = {split_port(target)[0] for target in draft.targets(f"{roles.plant}.e_q")} & makers
    power, oscillator = makers & set(roles.power), makers & set(draft.having(Element.OSCILLATOR))
    follows = [name for name, found in (("phase", phase), ("power", power), ("oscillator", oscillator)) if found]
    return " and ".join(follows or ["nothing"]) + (", voltage loop" if roles.voltage_loop else "")
