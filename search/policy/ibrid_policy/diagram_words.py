"""A diagram as words: each module with its kind, what drives its inputs, and which values it
shares.

#0 K:Rot_i .i_dq #1 .i_g .delta #2 .delta      (i_DQ first; a port is named where the kind has several)
"""

from collections.abc import Iterator, Mapping, Sequence

from ibrid.modules.kind import ModuleKind
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid_policy.numbering import OUT, OUTER, Numbered, Port, Slot
from ibrid_policy.tokens import BOX, FIXED, SAME, TIE, kind_word, module_word


def diagram_words(view: Numbered) -> list[str]:
    """The words of a numbered diagram."""
    words = [TERMINAL_CURRENT]
    for source in view.sources[OUT]:
        words += output_words(source, view.kinds)
    for number, kind in enumerate(view.kinds):
        words += [module_word(number), kind_word(kind.name)]
        for port in kind.inputs:
            words += [f".{port}"] if len(kind.inputs) > 1 else []
            for source in view.sources[number, port]:
                words += output_words(source, view.kinds)
        words += _values(view, number)
    return words


def output_words(source: Port, kinds: Sequence[ModuleKind]) -> list[str]:
    """The words of an output: the module, and the port where it has several."""
    number, port = source
    if number == OUTER:
        return [TERMINAL_VOLTAGE]
    return [module_word(number), *([f".{port}"] if len(kinds[number].outputs) > 1 else [])]


def input_words(target: Port, kinds: Sequence[ModuleKind]) -> list[str]:
    """The words of an input."""
    number, port = target
    if number == OUTER:
        return [TERMINAL_CURRENT]
    return [module_word(number), *([f".{port}"] if len(kinds[number].inputs) > 1 else [])]


def sharing_words(
    number: int, owners: Mapping[str, Slot], kinds: Sequence[ModuleKind]
) -> list[str]:
    """How the free parameters of a module share values of earlier modules; `owners` : parameter ->
    its owner.
    """
    strange = {parameter: slot for parameter, slot in owners.items() if slot != (number, parameter)}
    lenders = {slot[0] for slot in strange.values()}
    whole = len(lenders) == 1 and strange == {
        name: (min(lenders), name) for name in kinds[number].parameters
    }
    if whole and kinds[min(lenders)].name == kinds[number].name:
        return [SAME, module_word(min(lenders))]
    words = []
    for parameter, (lender, name) in strange.items():
        words += [TIE, f"@{parameter}", module_word(lender), f"@{name}"]
    return words


def _values(view: Numbered, number: int) -> Iterator[str]:
    bindings = view.instances[number].bindings
    for parameter in view.kinds[number].parameters:
        if isinstance(bindings.get(parameter), float | tuple):
            yield from (FIXED if isinstance(bindings[parameter], float) else BOX, f"@{parameter}")
    own = {
        name: view.owner[number, name]
        for name in view.kinds[number].parameters
        if (number, name) in view.owner
    }
    yield from sharing_words(number, own, view.kinds)
