"""The tokens of the policy: modules, ports, parameters, the parts of an edit, and levels of what a
record says.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

from ibrid.errors import IbridError

#: Modules that can be told apart by number.
MOST_MODULES = 64
#: Levels of the errors, of the measured sizes, of the whole error, and sectors of a phase.
ERROR_LEVELS, SIZE_LEVELS, TOTAL_LEVELS, SECTORS, SHARE_LEVELS = 9, 11, 23, 8, 5
#: Operating points that are counted; more count as the last.
MOST_POINTS = 3

PAD, END, ANSWER = "<pad>", "<end>", "<edit>"
#: What a kind, port or parameter without a word of its own is read as; the grammar never offers it.
UNKNOWN = PAD
#: Parts of an edit, in the order in which they may come.
SWAP, DELETE, ADD, AT, SAME, OWN, TIE, FREE = (
    "SWAP",
    "DEL",
    "ADD",
    "AT",
    "SAME",
    "OWN",
    "TIE",
    "FREE",
)
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
                f"the policy has no word for {error.args[0].partition(':')[2] or error.args[0]}; "
                "it knows the kinds that it was "
                f"trained with and up to {MOST_MODULES} modules, use another proposer"
            ) from None

    def read(self, words: Sequence[str]) -> list[int]:
        """Numbers of the words of a question, in which kinds, ports and parameters of one's own are
        UNKNOWN.
        """
        return self.encode(
            [UNKNOWN if word[0] in "K.@" and word not in self.ids else word for word in words]
        )

    def decode(self, numbers: Sequence[int]) -> list[str]:
        """Words of numbers."""
        return [self.words[number] for number in numbers]


def module_word(number: int) -> str:
    """The word for module `number`."""
    return f"#{number}"


def kind_word(kind: str) -> str:
    """The word for a kind."""
    return f"K:{kind}"


def _frozen() -> tuple[str, ...]:
    """The list that the shipped weights were trained with; a kind that is added to the vocabulary
    later has no word.
    """
    text = (files("ibrid_policy") / "weights" / "vocabulary.json").read_text(encoding="utf-8")
    return tuple(json.loads(text))


TOKENS = Tokens(_frozen())
