"""How good a policy is on lessons that it never saw: loss, share of valid edits, share of exact
repairs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.errors import DiagramError
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.editing.drafting import Draft
from ibrid_policy.backend import require, threads
from ibrid_policy.edit import made
from ibrid_policy.experience.damage import legal
from ibrid_policy.experience.examples import SETTINGS, Example
from ibrid_policy.grammar import Grammar
from ibrid_policy.interface import Sampled
from ibrid_policy.lessons import Lesson, batches, lesson_of
from ibrid_policy.numbering import Numbered, numbered
from ibrid_policy.sampling import draw_answers
from ibrid_policy.training import answer_loss


@dataclass(frozen=True)
class Measured:
    """Of `questions`: mean -log p of a whole answer (nats), share of single answers that lead to
    another legal structure, share that make exactly the repair, and share of questions where one of
    `tries` answers does.
    """

    questions: int
    loss: float
    valid: float
    exact: float
    exact_of_several: float
    tries: int


def measured(
    model: Any,
    examples: Sequence[Example],
    *,
    tries: int = 4,
    seed: int = 0,
    threads_used: int = 1,
    watch: Callable[[int, int], None] = lambda done, total: None,
) -> Measured:
    """Ask about each example, `tries` times, with the scale of its own answer."""
    pairs = [(one, lesson) for one in examples if (lesson := lesson_of(one)) is not None]
    if not pairs:
        return Measured(0, np.nan, np.nan, np.nan, np.nan, tries)
    model.eval()
    valid, exact, several = 0, 0, 0
    with threads(threads_used):
        loss = loss_of(model, [lesson for _, lesson in pairs])
        for place, (example, lesson) in enumerate(pairs):
            setting = next(one for one in SETTINGS if one.name == example.setting)
            view = numbered(
                parse_program(example.parent), setting.kinds, equilibrium=setting.equilibrium
            )
            wanted = structure_hash(
                parse_program(example.child), setting.kinds, equilibrium=setting.equilibrium
            )
            grammars = [Grammar(view, setting.kinds) for _ in range(tries)]
            answers = draw_answers(
                model, lesson.question.tolist(), grammars, np.random.default_rng([seed, place])
            )
            found = [
                _structure(answer, grammar, view, setting)
                for answer, grammar in zip(answers, grammars, strict=True)
            ]
            valid += found[0] is not None
            exact += found[0] == wanted
            several += wanted in found
            watch(place + 1, len(pairs))
    number = len(pairs)
    return Measured(number, loss, valid / number, exact / number, several / number, tries)


def loss_of(model: Any, lessons: Sequence[Lesson], size: int = 64) -> float:
    """Mean of -log p of the whole answers, nats, each lesson alike, within the grammar."""
    torch = require("torch")
    total = 0.0
    with torch.inference_mode():
        for batch in batches(lessons, size, np.random.default_rng(0), blurred=False):
            batch.weight[batch.target >= 0] = 1.0
            total += float(answer_loss(model, batch)) * int((batch.target >= 0).sum())
    return total / len(lessons)


def _structure(answer: Sampled, grammar: Grammar, view: Numbered, setting: Any) -> str | None:
    """Hash of the structure that an answer leads to; None for one that is not legal or not new."""
    if not grammar.ended:
        return None
    draft = Draft(made(view, grammar.edit, setting.kinds), setting.kinds)
    draft.tidy()
    child: Diagram = draft.diagram()
    if not legal(child, setting.kinds, setting.equilibrium):
        return None
    try:
        digest = structure_hash(child, setting.kinds, equilibrium=setting.equilibrium)
    except DiagramError:
        return None
    parent = structure_hash(view.diagram, setting.kinds, equilibrium=setting.equilibrium)
    return None if digest == parent else digest
