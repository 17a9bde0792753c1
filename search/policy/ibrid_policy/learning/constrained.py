"""From text that may come next to tokens that may come next, for any tokenizer: a trie of its texts
walked along slots.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ibrid_policy.learning.edit_automaton import EditAutomaton, Slot


@dataclass
class Trie:
    """Texts letter by letter. `tokens` : those whose text ends here."""

    tokens: list[int] = field(default_factory=list)
    following: dict[str, "Trie"] = field(default_factory=dict)

    def put(self, text: str, token: int) -> None:
        node = self
        for letter in text:
            node = node.following.setdefault(letter, Trie())
        node.tokens.append(token)


def trie_of(tokenizer: Any) -> tuple[Trie, dict[int, str]]:
    """The plain texts of a tokenizer, and the text of each token in it; special tokens are not
    among them.

    A token is read behind another one, since some tokenizers swallow a space at the beginning of a
    text.
    """
    root, texts = Trie(), {}
    anchor = tokenizer("a", add_special_tokens=False)["input_ids"][-1]
    before = tokenizer.decode([anchor])
    special = set(tokenizer.all_special_ids)
    for token in range(len(tokenizer)):
        if token in special:
            continue
        text = tokenizer.decode([anchor, token], clean_up_tokenization_spaces=False).removeprefix(
            before
        )
        if text and text.isascii():
            root.put(text, token)
            texts[token] = text
    return root, texts


@dataclass(frozen=True)
class Typed:
    """Where an answer is: in a slot, of whose alternatives `text` is written."""

    slot: Slot = field(default_factory=Slot)
    text: str = ""


class TokenGuide:
    """Tokens allowed after those of an answer so far; see `ibrid_policy.learning.sampling.Guide`.

    size : of the model's vocabulary. end : the token that is allowed, alone, when the edit is
    whole.
    """

    def __init__(
        self, automaton: EditAutomaton, trie: Trie, texts: dict[int, str], end: int, size: int
    ) -> None:
        self.automaton, self.trie, self.texts, self.end, self.size = (
            automaton,
            trie,
            texts,
            end,
            size,
        )
        self._reached: dict[tuple[int, ...], Typed] = {(): Typed()}
        self._masks: dict[Typed, np.ndarray] = {}

    def __call__(self, before: tuple[int, ...]) -> np.ndarray:
        place = self._place(before)
        if place not in self._masks:
            mask = np.zeros(self.size, dtype=bool)
            mask[self._allowed(place)] = True
            self._masks[place] = mask
        return self._masks[place]

    def masks(self, tokens: Sequence[int]) -> np.ndarray:
        """(L, V) for a whole answer."""
        return np.array([self(tuple(tokens[:place])) for place in range(len(tokens))])

    def _place(self, before: tuple[int, ...]) -> Typed:
        if before not in self._reached:
            place = self._place(before[:-1])
            for letter in self.texts[before[-1]]:
                place = self._moved(place, letter)
            self._reached[before] = place
        return self._reached[before]

    def _moved(self, place: Typed, letter: str) -> Typed:
        text = place.text + letter
        after = self.automaton.alternatives(place.slot).get(text)
        return Typed(place.slot, text) if after is None else Typed(after)

    def _allowed(self, place: Typed) -> list[int]:
        if not self.automaton.alternatives(place.slot):
            return [self.end]
        found: list[int] = []
        self._walk(self.trie, place, found)
        return found

    def _walk(self, node: Trie, place: Typed, found: list[int]) -> None:
        found += node.tokens
        begun, written = len(place.text), self.automaton.alternatives(place.slot)
        letters = {one[begun] for one in written if one.startswith(place.text)}
        for letter in sorted(letters & node.following.keys()):
            self._walk(node.following[letter], self._moved(place, letter), found)
