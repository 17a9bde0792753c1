"""A diagram as words, and back: each module with its kind, what drives its inputs, and which values it shares.

#0 K:Rot_i .i_dq #1 .i_g .delta #2 .delta      (i_DQ first; a port is named where the kind has several)
"""

from collections.abc import Iterator, Mapping, Sequence

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram
from ibrid_policy.numbering import IN, OUT, OUTER, Numbered, Port, Slot
from ibrid_policy.tokens import BOX, FIXED, SAME, TIE, LanguageError, kind_word, module_word


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


def sharing_words(number: int, owners: Mapping[str, Slot], kinds: Sequence[ModuleKind]) -> list[str]:
    """How the free parameters of a module share values of earlier modules; `owners` : parameter -> its owner."""
    strange = {parameter: slot for parameter, slot in owners.items() if slot != (number, parameter)}
    lenders = {slot[0] for slot in strange.values()}
    whole = len(lenders) == 1 and strange == {name: (min(lenders), name) for name in kinds[number].parameters}
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
    own = {name: view.owner[number, name] for name in view.kinds[number].parameters if (number, name) in view.owner}
    yield from sharing_words(number, own, view.kinds)


def diagram_of(words: Sequence[str], vocabulary: Vocabulary) -> Diagram:
    """The diagram of `diagram_words`, its modules called m0, m1 and so on.

    Raises LanguageError for a fixed value or a box, whose numbers the words do not hold.
    """
    known = {kind_word(kind.name): kind for kind in vocabulary}
    kinds = [known[word] for word in words if word in known]
    reader = _Reader(words, kinds)
    diagram = Diagram("build")
    for number, kind in enumerate(kinds):
        diagram.add(kind.name, f"m{number}", line=None, **reader.bindings.get(number, {}))
    for source, target in reader.wires:
        diagram.connect(_end(source), _end(target))
    return diagram


def _end(port: Port) -> str:
    return port[1] if port[0] == OUTER else f"m{port[0]}.{port[1]}"


class _Reader:
    """Reads the words from the left; `wires` and `bindings` are what it found."""

    def __init__(self, words: Sequence[str], kinds: Sequence[ModuleKind]) -> None:
        self.words, self.kinds = list(words), kinds
        self.wires: list[tuple[Port, Port]] = []
        self.bindings: dict[int, dict[str, str]] = {}
        target, number = OUT, OUTER
        at = 1
        while at < len(self.words):
            word = self.words[at]
            following = self.words[at + 1] if at + 1 < len(self.words) else ""
            if word in (FIXED, BOX):
                raise LanguageError("words of a diagram hold no fixed numbers and no boxes; write the program as text")
            if following.startswith("K:"):
                number = int(word[1:])
                ports = list(self.kinds[number].inputs)
                target, at = (number, ports[0] if ports else ""), at + 2
            elif word == SAME:
                lender = int(following[1:])
                self.bindings[number] = {name: f"m{lender}.{name}" for name in self.kinds[number].parameters}
                at += 2
            elif word == TIE:
                lender, name = self.words[at + 2][1:], self.words[at + 3][1:]
                self.bindings.setdefault(number, {})[following[1:]] = f"m{lender}.{name}"
                at += 4
            elif word == TERMINAL_VOLTAGE:
                self.wires.append((IN, target))
                at += 1
            elif word.startswith("."):
                target, at = (number, word[1:]), at + 1
            else:
                maker = int(word[1:])
                outputs = list(self.kinds[maker].outputs)
                port = following[1:] if len(outputs) > 1 else outputs[0]
                self.wires.append(((maker, port), target))
                at += 1 + (len(outputs) > 1)
