"""The proposer `llm`: one question to a language model, one edit; several models with weights,
limits for the whole run.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.errors import IbridError, ProgramError
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid_search.blocks import (
    LONGEST_EDIT,
    EditError,
    blocks_alone,
    has_blocks,
    shown,
    strip_thinking,
)
from ibrid_search.chat.chat import (
    LONGEST_ANSWER,
    Answer,
    Chat,
    ChatError,
    Message,
    estimated_tokens,
)
from ibrid_search.chat.chat_server import ChatServer, FormRefused
from ibrid_search.chat.spending import Limits, Prices, Spender, Spending
from ibrid_search.edits import apply_edit, edit_between
from ibrid_search.evaluation.judging import verdict_of
from ibrid_search.language_models.context import prompt
from ibrid_search.language_models.engineer_question import (
    TOKENS,
    engineer_question,
    ranked_edits,
    shown_programs,
)
from ibrid_search.proposal import Context, Evaluated, Origin, Proposal
from ibrid_search.proposers.diagnosis import handed_in
from ibrid_search.proposers.edit_fields import blocks_of, edit_schema, read_fields, writes
from ibrid_search.proposers.local_model import LocalModel
from ibrid_search.proposers.model_names import models_of
from ibrid_search.screening.edit_screening import ScreeningFit
from ibrid_search.step import Status

_CHANGE = "change:"
_EDIT_STEP = re.compile(r"^[ \t*#`]*EDIT STEP\W{0,4}(\d{1,9})\b", re.IGNORECASE | re.MULTILINE)
_TAKE = re.compile(r"^[ \t*#`]*TAKE\W{0,4}(\d{1,3})\b", re.MULTILINE)
#: A question with data and diagnosis, whose answer chooses what it edits; or that of the paper.
QUESTIONS = ("engineer", "paper")
#: Edits of its own in a row that are none, after which a model is held to those of the diagnosis;
#: and how they end.
SLIPS = 3
_SLIPS = (Status.NO_EDIT, Status.NO_MATCH, Status.AMBIGUOUS, Status.UNREADABLE, Status.ILLEGAL)
#: Tokens of a question at most, by its kind.
QUESTION_TOKENS = {"engineer": TOKENS, "paper": 16_000}


class LanguageModel(Spender):
    """Asks a model for an edit of the parent; a proposer in the sense of `ibrid_search.proposal`.

    `models` : each with its weight; one is drawn for every question. `limits` : of the run.
    `prompt_tokens` : of one question, `QUESTION_TOKENS` when not given. `asked` : of `QUESTIONS`;
    an engineer is asked about the best, sees every result before the next question, and may edit
    any program that it is shown; one that a server holds to a schema and that has written `SLIPS`
    edits in a row that are none chooses among those of the diagnosis. `spending` : so far.
    """

    name = "llm"
    attempts = 2
    window: int | None = None

    def __init__(
        self,
        models: Sequence[tuple[Chat, float]],
        *,
        limits: Limits | None = None,
        prompt_tokens: int | None = None,
        asked: str = "engineer",
    ) -> None:
        weights = np.array([weight for _, weight in models], dtype=float)
        if (
            not len(models)
            or not np.isfinite(weights).all()
            or (weights < 0).any()
            or not weights.sum() > 0
        ):
            raise IbridError(
                "the proposer llm needs at least one model and weights that are not negative; name "
                "one"
            )
        self.models = tuple(chat for chat, _ in models)
        self.weights = weights / weights.sum()
        if asked not in QUESTIONS:
            raise IbridError(
                f"a language model is asked as {' or '.join(QUESTIONS)}, found {asked!r}; choose "
                "one"
            )
        self.prompt_tokens, self.asked = prompt_tokens, asked
        if asked == "engineer":
            self.window, self.remembers = 1, 4
        self.spending = Spending(limits)
        self._slips: Counter[str] = Counter()

    @classmethod
    def from_options(
        cls,
        models: Sequence[str],
        *,
        limits: Limits | None = None,
        prices: Prices = (),
        asked: str = "engineer",
        **settings: Any,
    ) -> "LanguageModel":
        """Models by name: see `ibrid_search.proposers.model_names`; `settings` go to every
        ChatServer.

        Raises IbridError for a name that says nothing, a folder without a model or a package that
        is not installed.
        """
        return cls(models_of(models, prices, **settings), limits=limits, asked=asked)

    @property
    def tokens_of_a_question(self) -> int:
        """Of the longest question and the longest answer; 0 where a model says no limit of its
        answers.
        """
        answers = [getattr(chat, "max_tokens", 0) for chat in self.models]
        return (
            (self.prompt_tokens or QUESTION_TOKENS[self.asked]) + max(answers)
            if all(answers)
            else 0
        )

    def origin(self, number: int) -> Origin:
        """An engineer is always asked about the best."""
        return Origin(number, leading=self.asked == "engineer")

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """An edit of `context.parent`, or of another candidate that the model was shown; a failure
        in one sentence for whatever a server or a model does wrong.
        """
        chat = self.models[int(rng.choice(len(self.models), p=self.weights))]
        seed = int(rng.integers(2**31))
        if self.spending.over:
            return Proposal("", failure=self.spending.over)
        try:
            answer, form = self._answered(context, chat, seed)
        except IbridError as error:
            usage = error.usage if isinstance(error, ChatError) else {}
            self.count(usage)
            return Proposal("", usage=usage, failure=str(error))
        asked = {"model": chat.name, **answer.usage}
        self.count(asked)
        usage = {
            **asked,
            **({"cut": True} if answer.cut else {}),
            **({} if form == "text" else {"form": form}),
        }
        if form != "text" and (fields := read_fields(strip_thinking(answer.text)[1])) is not None:
            self.complain("")
            proposal = filled(fields, context, answer.text, usage)
        else:
            proposal = read_answer(answer.text, usage, chat.name)
            self.complain(proposal.failure)
            if self.asked == "engineer" and not proposal.failure:
                proposal = placed(proposal, context)
        if not proposal.failure and "taken" not in proposal.usage:
            slip = verdict_of(proposal, context).status in _SLIPS
            self._slips[chat.name] = self._slips[chat.name] + 1 if slip else 0
        return proposal

    def _answered(self, context: Context, chat: Chat, seed: int) -> tuple[Answer, str]:
        """An answer, and how the model was held to a schema; a server that refuses a way is asked
        in the next.
        """
        if isinstance(chat, ChatServer | LocalModel):
            chat = chat.bounded(self.spending.seconds_left, self.spending.questions_left, self.sent)
        while (
            self.asked == "engineer"
            and isinstance(chat, ChatServer | LocalModel)
            and chat.asked_form != "text"
        ):
            form, question = chat.asked_form, self._question(context, chat, fields=True)
            own = self._slips[chat.name] < SLIPS
            schema = edit_schema(
                shown_programs(context), context.study.kinds, len(ranked_edits(context)), own=own
            )
            with self.asking(chat.name):
                try:
                    return chat.fill(question, schema, form, seed), form
                except FormRefused as error:
                    self.count(error.usage)
                    if over := self.spending.over:
                        raise ChatError(over) from None
            chat = chat.bounded(self.spending.seconds_left, self.spending.questions_left, self.sent)
        question = self._question(context, chat)
        with self.asking(chat.name):
            return chat.complete(question, rng_seed=seed), "text"

    def _question(self, context: Context, chat: Chat, *, fields: bool = False) -> list[Message]:
        count = chat.tokens if isinstance(chat, LocalModel) else estimated_tokens
        if self.asked == "paper":
            return prompt(
                context, limit_tokens=self.prompt_tokens or QUESTION_TOKENS["paper"], count=count
            )
        return engineer_question(
            context, limit_tokens=self.prompt_tokens, count=count, fields=fields
        )


def filled(
    fields: Mapping[str, Any], context: Context, reply: str, usage: Mapping[str, Any]
) -> Proposal:
    """The edit that the fields of an answer say."""
    note, reply = shown(str(fields["change"])), reply[:LONGEST_ANSWER]
    if (look := taken(fields.get("take"), context)) is not None:
        return of_diagnosis(look, context, note, reply, usage)
    if not writes(fields):
        return Proposal("", note, reply, usage=usage)
    of = next(
        (one for one in shown_programs(context) if one.step == fields.get("step")), context.parent
    )
    try:
        edit = blocks_of(fields, of)
    except EditError as error:
        return Proposal("", note, reply, usage=usage, failure=error.reason)
    return Proposal(edit, note, reply, usage=usage, parent=of.step)


def taken(place: Any, context: Context) -> ScreeningFit | None:
    """The edit of the diagnosis with this number; None where there is none."""
    ranked = ranked_edits(context)
    return ranked[place - 1] if isinstance(place, int) and 0 < place <= len(ranked) else None


def of_diagnosis(
    look: ScreeningFit, context: Context, note: str, reply: str, usage: Mapping[str, Any]
) -> Proposal:
    """An edit of the diagnosis as the answer of a model; the note says first what changes."""
    found = handed_in(look, context, **usage, taken=True)
    said = f"{found.note} ({note})" if note else found.note
    return replace(found, note=said, reply=reply, parent=context.parent.step)


def placed(proposal: Proposal, context: Context) -> Proposal:
    """A proposal with the step that it edits: the one that the answer names, else the first shown
    program that it fits.

    In place of blocks an answer may take an edit of the diagnosis, or hold a whole program, which
    becomes the edit to it.
    """
    shown_ones = shown_programs(context)
    said = strip_thinking(proposal.reply)[1]
    take = None if has_blocks(proposal.edit) else _TAKE.search(said)
    if take and (look := taken(int(take[1]), context)) is not None:
        return of_diagnosis(look, context, proposal.note, proposal.reply, proposal.usage)
    named = _EDIT_STEP.search(said)
    of = next((one for one in shown_ones if named and one.step == int(named[1])), None)
    if not has_blocks(proposal.edit) and (whole := whole_program(said)):
        base = of or context.parent
        return replace(
            proposal, edit=edit_between(program_text(base.diagram), whole), parent=base.step
        )
    if of is None:
        of = next((one for one in shown_ones if _fits(proposal.edit, one)), context.parent)
    return replace(proposal, parent=of.step)


def whole_program(text: str) -> str:
    """The last whole program in an answer, as it is printed where it can be read; "" when there is
    none.
    """
    programs = [one for one in text.split("```")[1::2] if _BUILD.search(one)] or (
        [text] if _BUILD.match(text.strip()) else []
    )
    if not programs:
        return ""
    lines = programs[-1].strip("\n").split("\n")
    begin = next(number for number, line in enumerate(lines) if _BUILD.match(line.strip()))
    written = "\n".join(lines[begin:]) + "\n"
    try:
        return program_text(parse_program(written))
    except ProgramError:
        return written


_BUILD = re.compile(r"def \w{1,64}\(\w{1,64}\):", re.MULTILINE)


def _fits(edit: str, one: Evaluated) -> bool:
    try:
        apply_edit(edit, program_text(one.diagram))
    except EditError:
        return False
    return True


def read_answer(text: str, usage: Mapping[str, Any], name: str) -> Proposal:
    """The edit in an answer of model `name`.

    The thinking is kept, counted, and never read for edits.
    """
    thinking, rest = strip_thinking(text)
    if thinking and "thinking_tokens" not in usage:
        usage = {**usage, "thinking_tokens": estimated_tokens(thinking)}
    reply = text[:LONGEST_ANSWER]
    if not rest.strip():
        why = "thought until it was cut off and gave no answer" if thinking else "answered nothing"
        return Proposal("", reply=reply, usage=usage, failure=f"the model {name} {why}")
    if len(rest) > LONGEST_EDIT:
        failure = (
            f"the model {name} answered with {len(rest)} characters; an answer has at most "
            f"{LONGEST_EDIT}"
        )
        return Proposal("", reply=reply, usage=usage, failure=failure)
    return Proposal(blocks_alone(rest), note=_note(rest), reply=reply, usage=usage)


def _note(answer: str) -> str:
    """The line that says what changes; otherwise the last line before the first block."""
    before = [line for line in answer.partition("<<<<<")[0].splitlines() if line.strip(" `#*\t")]
    said = next((line for line in before if line.strip(" #*").lower().startswith(_CHANGE)), None)
    if said is not None:
        return shown(said.strip(" #*")[len(_CHANGE) :].strip(" *"))
    return shown(before[-1].strip(" #*")) if before else ""
