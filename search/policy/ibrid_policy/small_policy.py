"""The policy that ships: a causal transformer over the tokens of diagrams, residuals and edits."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ibrid_search.blocks import write_block
from ibrid_search.edits import edit_between
from ibrid_search.proposal import Context, Proposal

from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text
from ibrid.structure.editing.drafting import Draft
from ibrid_policy.backend import device, require, threads
from ibrid_policy.edit import NumberedEdit, made
from ibrid_policy.edit_words import read_edit
from ibrid_policy.grammar import LONGEST, Grammar
from ibrid_policy.interface import Sampled
from ibrid_policy.numbering import Numbered, numbered
from ibrid_policy.record_words import question_words, vocabulary_word
from ibrid_policy.residual import residual_of
from ibrid_policy.sampling import END_ID, allowed_masks, draw_answers
from ibrid_policy.tokens import TOKENS, LanguageError, kind_word
from ibrid_policy.weights_folder import load_model, shipped_folder


class SmallPolicy:
    """See `ibrid_policy.interface.Policy`. folder : its weights; None: those that ship. model : in
    place of a folder's.

    The weights are read here, so that a search which cannot use them ends before anything is
    fitted. Raises IbridError where torch or transformers is missing, and for a folder without
    weights or with damaged ones.
    """

    name = "policy"
    end = END_ID

    def __init__(
        self, folder: str | Path | None = None, *, model: Any = None, threads: int = 1
    ) -> None:
        require("torch")
        self.folder = shipped_folder() if folder is None else Path(folder)
        self.threads = threads
        self._model = (load_model(self.folder) if model is None else model).to(device())

    def model(self) -> Any:
        """The transformer, float32, on a GPU where there is one."""
        return self._model

    def prompt(self, context: Context) -> list[int]:
        """Tokens of a question; LanguageError (an IbridError) for a diagram with too many
        modules.
        """
        study, parent = context.study, context.parent
        setting = (vocabulary_word(study.kinds), study.equilibrium, study.parameters)
        residual = residual_of(parent.record, study.sweep)
        return TOKENS.read(question_words(_view(context), residual, context.scale, setting))

    def sample(
        self, prompts: Sequence[Sequence[int]], contexts: Sequence[Context], number: int, seed: int
    ) -> list[list[Sampled]]:
        """`number` answers to each prompt, all within the grammar."""
        model, found = self._model, []
        model.eval()
        with threads(self.threads):
            for place, (prompt, context) in enumerate(zip(prompts, contexts, strict=True)):
                grammars = self._grammars(context, number)
                found.append(
                    draw_answers(model, prompt, grammars, np.random.default_rng([seed, place]))
                )
        return found

    def proposal(self, sampled: Sampled, context: Context) -> Proposal:
        """The edit, what it leaves idle tidied away; an answer that changes nothing repeats a line
        of the program.
        """
        view = _view(context)
        if sampled.tokens[-1:] != (self.end,):
            return Proposal(
                "", failure=f"the answer of the policy did not end within {LONGEST} tokens"
            )
        try:
            edit = read_edit(TOKENS.decode(sampled.tokens), view, _spoken(context))
        except LanguageError as error:
            return Proposal(
                "", failure=f"the answer of the policy is no edit of this parent: {error}"
            )
        child = _tidied(made(view, edit, context.study.kinds), context)
        before, after = program_text(view.diagram), program_text(child)
        note = note_of(edit, view)
        if before == after:
            line = before.splitlines()[-1]
            return Proposal(write_block([line], [line]), note="nothing changed")
        return Proposal(edit_between(before, after), note=note)

    def masks(self, prompt: Sequence[int], tokens: Sequence[int], context: Context) -> np.ndarray:
        """Which tokens the grammar allowed, (L, V)."""
        return allowed_masks(tokens, self._grammars(context, 1)[0])

    def _grammars(self, context: Context, number: int) -> list[Grammar]:
        view = _view(context)
        return [Grammar(view, _spoken(context)) for _ in range(number)]


def note_of(edit: NumberedEdit, view: Numbered) -> str:
    """What an edit changes, in a line."""
    parts = [
        f"{kind} for {view.kinds[number].name} {view.names[number]}"
        for number, kind in edit.swapped
    ]
    if edit.added:
        parts.append(f"with {', '.join(edit.added)}")
    if edit.removed:
        parts.append(f"without {', '.join(view.names[number] for number in edit.removed)}")
    if not parts and edit.rewired:
        parts.append("wires moved")
    if edit.owners:
        parts.append("other shared parameters")
    return "; ".join(parts)


def _spoken(context: Context) -> Vocabulary:
    """The kinds of the study that the language has words for: those of one's own are left to other
    proposers.
    """
    return tuple(kind for kind in context.study.kinds if kind_word(kind.name) in TOKENS.ids)


def _view(context: Context) -> Numbered:
    return numbered(
        context.parent.diagram, context.study.kinds, equilibrium=context.study.equilibrium
    )


def _tidied(diagram: Diagram, context: Context) -> Diagram:
    draft = Draft(diagram, context.study.kinds)
    draft.tidy()
    return draft.diagram()
