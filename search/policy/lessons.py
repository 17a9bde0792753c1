"""Examples as tokens: a question, the answer, how much it counts; and batches of them, a little blurred each time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import exp

import numpy as np

from ibrid.structure.program import parse_program
from search.policy.edit import Edit, difference
from search.policy.experience.examples import SETTINGS, Example
from search.policy.grammar import LONGEST, edit_words
from search.policy.numbering import Numbered, numbered
from search.policy.record_words import question_words
from search.policy.tokens import PAD, TOKENS, LanguageError
from search.proposal import SCALES

#: How often a question asks for the scale that the answer has; else for one at random, as a search does.
TRUE_SCALE = 0.4
_ASKED = (0.3, 0.4, 0.3)
#: How often a level is told one off, and a phase or a size not at all.
_BLURRED, _LEFT_OUT = 0.08, 0.04


@dataclass(frozen=True, eq=False)
class Lesson:
    """`question`, `answer` : tokens. `scale_at` : place of the scale in the question. `weight` : from 0 to 1.

    `scale` : of the answer. `example` : its number of inverter, what it repairs and its family, for the measurement.
    """

    question: np.ndarray
    answer: np.ndarray
    scale: str
    weight: float
    inverter: int
    what: str
    family: str

    @property
    def length(self) -> int:
        """Tokens in all."""
        return len(self.question) + len(self.answer)


def lesson_of(example: Example) -> Lesson | None:
    """The lesson of an example; None where the language cannot say it or its answer is too long."""
    setting = next(one for one in SETTINGS if one.name == example.setting)
    view = numbered(parse_program(example.parent), setting.kinds, equilibrium=setting.equilibrium)
    words = (setting.name, setting.equilibrium, setting.parameters)
    try:
        edit = difference(view, parse_program(example.child), setting.kinds, equilibrium=setting.equilibrium)
        scale = scale_of(edit, view)
        answer = TOKENS.encode(edit_words(edit, view, setting.kinds))
        question = TOKENS.encode(question_words(view, example.residual, scale, words))
    except LanguageError:
        return None
    if len(answer) > LONGEST or len(answer) < 2:
        return None
    return Lesson(
        np.array(question, np.int64), np.array(answer, np.int64), scale, weight_of(example), example.inverter,
        example.what, example.family,
    )  # fmt: skip


def weight_of(example: Example) -> float:
    """How much an example counts: by what the repair gains, less for a repair whose gain nobody measured.

    A slip undone counts in full also where the error stays: it makes the diagram simpler.
    """
    if example.gain is None:
        return 0.4
    if example.what == "slip":
        return 0.5
    full = 0.6 if example.what == "parts" else 0.3
    return 0.05 + 0.95 * (1 - exp(-2 * max(example.gain, 0.0) / full))


def scale_of(edit: Edit, view: Numbered) -> str:
    """local: wires and shared parameters; module: up to two modules; structural: more, or the filter."""
    touched = len(edit.swapped) + len(edit.removed) + len(edit.added)
    plant = any("u_r" in view.kinds[number].inputs for number, _ in edit.swapped)
    return "structural" if plant or touched > 2 else "module" if touched else "local"


def lessons_of(examples: Iterable[Example]) -> list[Lesson]:
    """The lessons of examples, in their order."""
    return [lesson for example in examples if (lesson := lesson_of(example)) is not None]


@dataclass(frozen=True, eq=False)
class Batch:
    """`tokens` (B, L) padded at the end; `target` (B, L) the next token where it belongs to an answer, else -1;
    `weight` (B,)."""

    tokens: np.ndarray
    target: np.ndarray
    weight: np.ndarray


def batches(lessons: Sequence[Lesson], size: int, rng: np.random.Generator, *, blurred: bool = True) -> Iterator[Batch]:
    """All lessons once, those of like length together, in random order."""
    lengths = np.array([one.length for one in lessons]) * rng.uniform(0.9, 1.1, len(lessons))
    order = np.argsort(lengths, kind="stable")
    groups = [order[start : start + size] for start in range(0, len(order), size)]
    for index in rng.permutation(len(groups)) if blurred else range(len(groups)):
        yield batch_of([lessons[one] for one in groups[index]], rng, blurred=blurred)


def batch_of(lessons: Sequence[Lesson], rng: np.random.Generator, *, blurred: bool = True) -> Batch:
    """Lessons side by side."""
    longest = max(one.length for one in lessons)
    tokens = np.full((len(lessons), longest), TOKENS.ids[PAD], np.int64)
    target = np.full((len(lessons), longest), -1, np.int64)
    for row, one in enumerate(lessons):
        question = blur(one.question, rng) if blurred else one.question.copy()
        question[-2] = TOKENS.ids[f"scale:{asked_scale(one.scale, rng) if blurred else one.scale}"]
        split, end = len(question), len(question) + len(one.answer)
        tokens[row, :split], tokens[row, split:end] = question, one.answer
        target[row, split - 1 : end - 1] = one.answer
    return Batch(tokens, target, np.array([one.weight for one in lessons]))


def asked_scale(scale: str, rng: np.random.Generator) -> str:
    """The scale that a question asks for: a search draws it without knowing the answer."""
    return scale if rng.random() < TRUE_SCALE else str(rng.choice(SCALES, p=_ASKED))


def blur(question: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Some levels one off, some sizes and phases left out: what a search sees is never quite what was trained on."""
    low, high, optional = _levels()
    levels = high[question] > low[question]
    moved = levels & (rng.random(len(question)) < _BLURRED)
    step = np.where(rng.random(len(question)) < 0.5, -1, 1)
    found = np.where(moved, np.clip(question + step, low[question], high[question]), question)
    return found[~(optional[question] & (rng.random(len(question)) < _LEFT_OUT))]


@cache
def _levels() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest token of the scale on which a token is a level, and whether it may be left out."""
    groups: dict[str, list[int]] = {}
    for number, word in enumerate(TOKENS.words):
        if word.split(":")[0] in ("total", "share", "error", "size"):
            groups.setdefault(word.rpartition(":")[0], []).append(number)
    low, high = np.arange(len(TOKENS)), np.arange(len(TOKENS))
    for members in groups.values():
        low[members], high[members] = members[0], members[-1]
    optional = np.array([word.split(":")[0] in ("turn", "angle", "size") for word in TOKENS.words])
    return low, high, optional
