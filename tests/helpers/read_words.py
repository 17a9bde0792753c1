"""The words of a diagram, read back: what `ibrid_policy.diagram_words` says is all of it."""

from collections.abc import Sequence

from ibrid_policy.numbering import IN, OUT, OUTER, Port
from ibrid_policy.tokens import BOX, FIXED, SAME, TIE, LanguageError, kind_word

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE, Diagram


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
                raise LanguageError(
                    "words of a diagram hold no fixed numbers and no boxes; write the program as "
                    "text"
                )
            if following.startswith("K:"):
                number = int(word[1:])
                ports = list(self.kinds[number].inputs)
                target, at = (number, ports[0] if ports else ""), at + 2
            elif word == SAME:
                lender = int(following[1:])
                self.bindings[number] = {
                    name: f"m{lender}.{name}" for name in self.kinds[number].parameters
                }
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
