"""Families of control as an engineer says them, by what sets the frequency of a controller's
frame.
"""

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram
from ibrid_search.archives.appraisal import sort_of_control

#: What control of a sort is called.
_FAMILIES = {
    "phase": "grid-following, a PLL gives its angle",
    "power": "grid-forming, power sets its frequency",
    "oscillator": "grid-forming, an oscillator sets its frequency",
    "nothing": "without synchronisation",
}


def family_words(sort: str) -> str:
    """A sort of control as an engineer says it."""
    first, beside, second = sort.partition(" beside ")
    if beside:
        return f"two devices in parallel: {family_words(first)}; {family_words(second)}"
    names = [_FAMILIES.get(word, word) for word in _words(sort)]
    _, _, loop = sort.partition(", ")
    return " and ".join(names) + (f", with a {loop}" if loop else "")


def follows(diagram: Diagram, kinds: Vocabulary) -> set[str]:
    """What sets the frequency of a diagram's frame, of two devices of both: phase, power,
    oscillator or nothing.
    """
    devices = sort_of_control(diagram, kinds).split(" beside ")
    return {word for device in devices for word in _words(device)}


def _words(sort: str) -> list[str]:
    """Of one device."""
    return sort.partition(", ")[0].split(" and ")
