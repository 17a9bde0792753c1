"""Examples as tokens: a question, its answers, how much each counts; and batches of them, a little
blurred each time.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import exp

import numpy as np
from ibrid_search.evaluated import SCALES

from ibrid.structure.diagrams.program import parse_program
from ibrid_policy.edit import NumberedEdit, difference
from ibrid_policy.edit_words import edit_words
from ibrid_policy.experience.examples import SETTINGS, Example
from ibrid_policy.grammar import LONGEST, Grammar
from ibrid_policy.numbering import Numbered, numbered
from ibrid_policy.record_words import question_words
from ibrid_policy.tokens import PAD, TOKENS, LanguageError

#: How often a question asks for the scale that an answer has; else for one at random, as a search
#: does.
TRUE_SCALE = 0.4
_ASKED = (0.3, 0.4, 0.3)
#: How often a level is told one off, and a phase or a size not at all.
_BLURRED, _LEFT_OUT = 0.08, 0.04


@dataclass(frozen=True, eq=False)
class LessonAnswer:
    """`tokens` : of an edit, the end included.

    `allowed` : what the grammar allowed at each place. `scale` : how far it reaches. `weight` : how
    much it counts, 0 to 1.
    """

    tokens: np.ndarray
    allowed: tuple[np.ndarray, ...]
    scale: str
    weight: float


@dataclass(frozen=True, eq=False)
class Lesson:
    """`question` : tokens, the scale the last but one. `answers` : edits that repair the same
    parent.
    """

    question: np.ndarray
    answers: tuple[LessonAnswer, ...]

    @property
    def length(self) -> int:
        """Tokens in all."""
        return len(self.question) - 1 + sum(1 + len(one.tokens) for one in self.answers)


def lesson_of(example: Example) -> Lesson | None:
    """The lesson of an example; None where the language cannot say it, and for answers that are too
    long or change nothing.
    """
    setting = next(one for one in SETTINGS if one.name == example.setting)
    view = numbered(parse_program(example.parent), setting.kinds, equilibrium=setting.equilibrium)
    words = (setting.name, setting.equilibrium, setting.parameters)
    try:
        edit = difference(
            view, parse_program(example.child), setting.kinds, equilibrium=setting.equilibrium
        )
        scale = scale_of(edit, view)
        answer = TOKENS.encode(edit_words(edit, view, setting.kinds))
        question = TOKENS.encode(question_words(view, example.residual, scale, words))
        if not 2 <= len(answer) <= LONGEST:
            return None
        allowed = _allowed(answer, Grammar(view, setting.kinds))
    except LanguageError:
        return None
    return Lesson(
        np.array(question, np.int64),
        (LessonAnswer(np.array(answer, np.int64), allowed, scale, weight_of(example)),),
    )


def _allowed(answer: Sequence[int], grammar: Grammar) -> tuple[np.ndarray, ...]:
    found = []
    for token in answer:
        found.append(np.array(TOKENS.encode(grammar.allowed), np.int16))
        grammar.take(TOKENS.words[token])
    return tuple(found)


def lessons_of(examples: Iterable[Example]) -> list[Lesson]:
    """The lessons of examples, in their order; answers to the same question are one lesson."""
    found: dict[tuple[int, ...], Lesson] = {}
    for example in examples:
        lesson = lesson_of(example)
        if lesson is None:
            continue
        key = (example.inverter, *lesson.question[:-2].tolist())
        before = found.get(key)
        found[key] = (
            lesson
            if before is None
            else replace(before, answers=(*before.answers, *lesson.answers))
        )
    return list(found.values())


def weight_of(example: Example) -> float:
    """How much an example counts: by what the repair gains, less for a repair whose gain nobody
    measured.

    A slip undone counts also where the error stays: it makes the diagram simpler.
    """
    if example.gain is None:
        return 0.4
    if example.what == "slip":
        return 0.5
    full = 0.6 if example.what == "parts" else 0.3
    return 0.05 + 0.95 * (1 - exp(-2 * max(example.gain, 0.0) / full))


def scale_of(edit: NumberedEdit, view: Numbered) -> str:
    """local: wires and shared parameters; module: up to two modules; structural: more, or the
    filter.
    """
    touched = len(edit.swapped) + len(edit.removed) + len(edit.added)
    plant = any("u_r" in view.kinds[number].inputs for number, _ in edit.swapped)
    return "structural" if plant or touched > 2 else "module" if touched else "local"


@dataclass(frozen=True, eq=False)
class LessonBatch:
    """Lessons side by side, each row a question and its answers, padded at the end; arrays (B, L).

    `target` : the next token where it belongs to an answer, else -1. `weight` : of it. `position` :
    as if each answer followed its question directly. `part` : 0 in a question, 1, 2, .. in its
    answers, which do not see each other; -1 in the padding. `allowed` (N, V) bool: what the grammar
    allowed at each of the N places with a target, row by row.
    """

    tokens: np.ndarray
    target: np.ndarray
    weight: np.ndarray
    position: np.ndarray
    part: np.ndarray
    allowed: np.ndarray

    @property
    def sees(self) -> np.ndarray:
        """(B, 1, L, L) bool: a token sees its question and what comes before it in its own
        answer.
        """
        before = np.tril(np.ones((self.tokens.shape[1],) * 2, dtype=bool))
        alike = (self.part[:, None, :] == 0) | (self.part[:, None, :] == self.part[:, :, None])
        return (before & alike)[:, None]


def batches(
    lessons: Sequence[Lesson], size: int, rng: np.random.Generator, *, blurred: bool = True
) -> Iterator[LessonBatch]:
    """All lessons once, those of like length together, in random order."""
    lengths = np.array([one.length for one in lessons]) * (
        rng.uniform(0.9, 1.1, len(lessons)) if blurred else 1.0
    )
    order = np.argsort(lengths, kind="stable")
    groups = [order[start : start + size] for start in range(0, len(order), size)]
    for index in rng.permutation(len(groups)) if blurred else range(len(groups)):
        yield batch_of([lessons[one] for one in groups[index]], rng, blurred=blurred)


def batch_of(
    lessons: Sequence[Lesson], rng: np.random.Generator, *, blurred: bool = True
) -> LessonBatch:
    """Lessons side by side; what is not blurred is asked for the scale of its first answer."""
    shape = (len(lessons), max(one.length for one in lessons))
    tokens, target = np.full(shape, TOKENS.ids[PAD], np.int64), np.full(shape, -1, np.int64)
    position, part = np.zeros(shape, np.int64), np.full(shape, -1, np.int64)
    weight = np.zeros(shape)
    for row, one in enumerate(lessons):
        question = blur(one.question, rng) if blurred else one.question.copy()
        chosen = one.answers[int(rng.integers(len(one.answers))) if blurred else 0].scale
        question[-2] = TOKENS.ids[f"scale:{asked_scale(chosen, rng) if blurred else chosen}"]
        at = asked = len(question) - 1  # each answer has the token that asks for it to itself
        tokens[row, :at], position[row, :at], part[row, :at] = question[:-1], np.arange(at), 0
        for number, answer in enumerate(one.answers, 1):
            end = at + 1 + len(answer.tokens)
            tokens[row, at:end], part[row, at:end] = [question[-1], *answer.tokens], number
            position[row, at:end] = asked + np.arange(end - at)
            target[row, at : end - 1], weight[row, at : end - 1] = answer.tokens, answer.weight
            at = end
    places = [one for lesson in lessons for answer in lesson.answers for one in answer.allowed]
    allowed = np.zeros((len(places), len(TOKENS)), dtype=bool)
    for row, one in enumerate(places):
        allowed[row, one] = True
    return LessonBatch(tokens, target, weight, position, part, allowed)


def asked_scale(scale: str, rng: np.random.Generator) -> str:
    """The scale that a question asks for: a search draws it without knowing the answer."""
    return scale if rng.random() < TRUE_SCALE else str(rng.choice(SCALES, p=_ASKED))


def blur(question: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Some levels one off, some sizes and phases left out: what a search sees is never quite what
    was trained on.
    """
    low, high, optional = _levels()
    levels = high[question] > low[question]
    moved = levels & (rng.random(len(question)) < _BLURRED)
    step = np.where(rng.random(len(question)) < 0.5, -1, 1)
    found = np.where(moved, np.clip(question + step, low[question], high[question]), question)
    return found[~(optional[question] & (rng.random(len(question)) < _LEFT_OUT))]


@cache
def _levels() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest token of the scale on which a token is a level, and whether it may be left
    out.
    """
    groups: dict[str, list[int]] = {}
    for number, word in enumerate(TOKENS.words):
        if word.split(":")[0] in ("total", "share", "error", "size"):
            groups.setdefault(word.rpartition(":")[0], []).append(number)
    low, high = np.arange(len(TOKENS)), np.arange(len(TOKENS))
    for members in groups.values():
        low[members], high[members] = members[0], members[-1]
    optional = np.array([word.split(":")[0] in ("turn", "angle", "size") for word in TOKENS.words])
    return low, high, optional
