"""The tokens of the policy: modules, ports, parameters, the parts of an edit, and levels of what a record says."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from ibrid_search.proposal import SCALES

from ibrid.errors import IbridError
from ibrid.fit.objective import BAND_NAMES
from ibrid.measurement.sweep import ENTRIES
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE

#: Modules that can be told apart by number.
MOST_MODULES = 64
#: Levels of the errors, of the measured sizes, of the whole error, and sectors of a phase.
ERROR_LEVELS, SIZE_LEVELS, TOTAL_LEVELS, SECTORS, SHARE_LEVELS = 9, 11, 23, 8, 5
#: Operating points that are counted; more count as the last.
MOST_POINTS = 3

PAD, END, ANSWER = "<pad>", "<end>", "<edit>"
#: Parts of an edit, in the order in which they may come.
SWAP, DELETE, ADD, AT, SAME, OWN, TIE, FREE = "SWAP", "DEL", "ADD", "AT", "SAME", "OWN", "TIE", "FREE"
CUT, WIRE = "-", "+"
FIXED, BOX, BOUND = "FIXED", "BOX", "BOUND"


class LanguageError(IbridError):
    """Something that the language of the policy has no words for."""


@dataclass(frozen=True)
class Tokens:
    """Words and their numbers. `words` : all, in order; the number of a word is its place."""

    words: tuple[str, ...]

    @cached_property
    def ids(self) -> dict[str, int]:
        """Word -> number."""
        return {word: number for number, word in enumerate(self.words)}

    def __len__(self) -> int:
        return len(self.words)

    def encode(self, words: Sequence[str]) -> list[int]:
        """Numbers of words; LanguageError for one that the language lacks."""
        try:
            return [self.ids[word] for word in words]
        except KeyError as error:
            raise LanguageError(
                f"the policy has no word for {error.args[0].partition(':')[2] or error.args[0]}; it knows the shipped kinds "
                f"and up to {MOST_MODULES} modules, use another proposer"
            ) from None

    def decode(self, numbers: Sequence[int]) -> list[str]:
        """Words of numbers."""
        return [self.words[number] for number in numbers]


def module_word(number: int) -> str:
    """The word for module `number`."""
    return f"#{number}"


def kind_word(kind: str) -> str:
    """The word for a kind."""
    return f"K:{kind}"


def _words() -> Iterator[str]:
    yield from (PAD, END, ANSWER)
    yield from (SWAP, DELETE, ADD, AT, CUT, WIRE, SAME, OWN, TIE, FREE, FIXED, BOX, BOUND)
    yield from (TERMINAL_VOLTAGE, TERMINAL_CURRENT)
    yield from (f"vocabulary:{one}" for one in ("paper", "extended"))
    yield from (f"equilibrium:{one}" for one in ("paper", "exact"))
    yield from (f"parameters:{one}" for one in ("per-op", "shared"))
    yield from (f"scale:{one}" for one in SCALES)
    yield from (f"points:{number}" for number in range(1, MOST_POINTS + 1))
    yield from (f"total:{level}" for level in range(TOTAL_LEVELS))
    for band in range(len(BAND_NAMES)):
        yield from (f"share:{band}:{level}" for level in range(SHARE_LEVELS))
    for what, levels in (("error", ERROR_LEVELS), ("turn", SECTORS), ("size", SIZE_LEVELS), ("angle", SECTORS)):
        for band in range(len(BAND_NAMES)):
            for entry in ENTRIES:
                yield from (f"{what}:{band}:{entry}:{level}" for level in range(levels))
    yield from (kind_word(kind.name) for kind in VOCABULARY)
    yield from (module_word(number) for number in range(MOST_MODULES))
    yield from sorted({f".{port}" for kind in VOCABULARY for port in (*kind.inputs, *kind.outputs)})
    yield from sorted({f"@{name}" for kind in VOCABULARY for name in kind.parameters})


TOKENS = Tokens(tuple(_words()))
