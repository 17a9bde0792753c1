"""Names of control families, by what sets the frequency of the controller's dq frame."""

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram
from ibrid_search.archives.appraisal import sort_of_control

#: Synchronisation, as `sort_of_control` names it -> the name that engineers use.
_FAMILY_NAMES = {
    "phase": "grid-following, a PLL gives its angle",
    "power": "grid-forming, power sets its frequency",
    "oscillator": "grid-forming, an oscillator sets its frequency",
    "nothing": "without synchronisation",
}
#: Separates the devices in `sort_of_control`.
_BETWEEN_DEVICES = " beside "


def describe_family(sort: str) -> str:
    """Describe a sort of control, as returned by `sort_of_control`, in words.

    "power, voltage loop" gives "grid-forming, power sets its frequency, with a voltage loop".
    """
    first, parallel, second = sort.partition(_BETWEEN_DEVICES)
    if parallel:
        return f"two devices in parallel: {describe_family(first)}; {describe_family(second)}"
    names = [_FAMILY_NAMES.get(name, name) for name in _synchronisations(sort)]
    description = " and ".join(names)
    _, _, loop = sort.partition(", ")
    return f"{description}, with a {loop}" if loop else description


def list_synchronisations(diagram: Diagram, kinds: Vocabulary) -> set[str]:
    """List what sets the frame frequency of a diagram: phase, power, oscillator or nothing.

    Of two devices in parallel, those of both.
    """
    devices = sort_of_control(diagram, kinds).split(_BETWEEN_DEVICES)
    return {name for device in devices for name in _synchronisations(device)}


def _synchronisations(sort: str) -> list[str]:
    """Return the synchronisations in the sort of control of one device."""
    synchronisation, _, _ = sort.partition(", ")
    return synchronisation.split(" and ")
