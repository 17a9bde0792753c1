"""A language model asked, and what became of each of its answers, in the words of a search."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from ibrid_bench.language_model.questions import INVERTERS, MODE, PLACES, Question
from ibrid_bench.search.inverters import inverter
from ibrid_policy.backend import threads
from ibrid_policy.interface import Policy
from ibrid_policy.learning.learner import Learner
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.updates import META, read_updates
from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.evaluation.judging import verdict_of
from ibrid_search.proposal import Proposal
from ibrid_search.proposers.choose import Proposers
from ibrid_search.proposers.language_model import QUESTION_TOKENS, LanguageModel
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.settings import SearchSettings

Row = Mapping[str, Any]

#: How answers are drawn: any text, or edits of `ibrid_policy.learning.edit_automaton` alone.
WAYS = ("free", "constrained")
#: By a server, with the whole question of an engineer, held to the JSON schema of an edit; tokens
#: of such an answer at most.
SCHEMA, LONGEST_FIELDS = "schema", 600
#: The weights as they were saved, and after a search that trains them.
STATES = ("as it is", "after learning")
#: A small batch that a CPU masters: an update after each question, by first looks at its four
#: answers, along the gradient; the shortest form of the question, answers of three lines of SEARCH
#: and REPLACE at most.
SETTINGS = LearningSettings(
    contexts=1, group=4, judge="look", optimizer="sgd", constrained=True, longest=220, question=4000
)
#: Of the search during which it learns: another seed than that of the questions.
LEARNT_ON, LEARNING_SEED, LEARNING_BUDGET = "paper_like", 1, 3


class Guided(Policy, Protocol):
    """A language model as a policy, whose answers can be held to edits: a
    `ibrid_policy.learning.text_policy.TextPolicy`.
    """

    constrained: bool


@dataclass(frozen=True)
class Case:
    """A question asked in one way.

    `model` : name and digest of the weights. `state` : of `STATES`.
    """

    model: str
    state: str
    way: str
    inverter: str
    place: int

    @property
    def key(self) -> str:
        """Names the row in the ledger."""
        return "-".join(
            [
                *self.model.split(),
                self.state.replace(" ", "_"),
                self.way,
                self.inverter,
                str(self.place),
                size(self.way),
            ]
        )

    @property
    def seed(self) -> int:
        """Of the answers: the same in every state and way, another for every question, since the
        first ones are much alike.
        """
        return self.place + 1000 * INVERTERS.index(self.inverter)


def cases(model: str) -> Iterator[Case]:
    """All of them, in the order in which they are asked; after the weights have changed the way
    that was trained comes first.
    """
    for state in STATES:
        for way in (SCHEMA, *WAYS) if state == STATES[0] else reversed(WAYS):
            for name in INVERTERS:
                for place in PLACES:
                    yield Case(model, state, way, name, place)


def size(way: str = WAYS[0]) -> str:
    """Of questions and answers, since another one gives other shares: answers x tokens of an
    answer, tokens of a question.
    """
    longest, asked = (
        (LONGEST_FIELDS, QUESTION_TOKENS["engineer"])
        if way == SCHEMA
        else (SETTINGS.longest, SETTINGS.question)
    )
    return f"{SETTINGS.group}x{longest}-{asked}"


def answered(case: Case, question: Question, policy: Guided) -> Row:
    """The answers to a question; `seconds` : of the processor, the reading of the question too."""
    policy.constrained = case.way == "constrained"
    prompt = policy.prompt(question.context)
    began = time.process_time()
    with threads(SETTINGS.threads):
        (drawn,) = policy.sample([prompt], [question.context], SETTINGS.group, case.seed)
    proposals = [_counted(policy.proposal(one, question.context), len(one.tokens)) for one in drawn]
    return _row(case, question, proposals, len(prompt), time.process_time() - began)


def served(model: str, address: str) -> LanguageModel:
    """A model behind a server as `--proposer llm` has it."""
    return LanguageModel(
        [(ChatServer(model.split()[0], address, timeout=600.0, retries=0, form="schema"), 1.0)]
    )


def answered_by_server(case: Case, question: Question, proposer: LanguageModel) -> Row:
    """The same of a server."""
    began = time.process_time()
    proposals = [
        proposer.propose(question.context, np.random.default_rng(case.seed + 100_000 * k))
        for k in range(SETTINGS.group)
    ]
    read = max(int(one.usage.get("prompt_tokens", 0)) for one in proposals)
    return _row(case, question, proposals, read, time.process_time() - began)


def _counted(proposal: Proposal, number: int) -> Proposal:
    """A proposal that tells how many tokens its answer has."""
    return replace(proposal, usage={**proposal.usage, "completion_tokens": number})


def _row(
    case: Case, question: Question, proposals: Sequence[Proposal], read: int, seconds: float
) -> Row:
    answers = []
    for proposal in proposals:
        verdict = verdict_of(proposal, question.context)
        answers.append(
            {
                "status": str(verdict.status),
                "reason": verdict.reason,
                "cut": bool(proposal.usage.get("cut")),
                "tokens": int(proposal.usage.get("completion_tokens", 0)),
                "reply": proposal.reply,
            }
        )
    return {
        "key": case.key,
        **asdict(case),
        "parent_nrmse": question.context.parent.record.nrmse,
        "question_tokens": read,
        "answers": answers,
        "seconds": round(seconds, 1),
    }


def learnt(model: str, policy: Guided, folder: Path, search: Any) -> Row:
    """Let the model propose in a search of its own that trains it, so that its weights are others
    afterwards; the row tells its updates, and ends the search after as many answers without a new
    structure as it has evaluations.
    """
    policy.constrained = SETTINGS.constrained
    learner = Learner(policy, SETTINGS, seed=LEARNING_SEED, window=SearchSettings().window)
    began = time.process_time()
    search(
        inverter(LEARNT_ON).sweep,
        folder,
        proposer=Proposers(learner, learn=SETTINGS),
        budget=LEARNING_BUDGET,
        seed=LEARNING_SEED,
        settings=SearchSettings(patience=LEARNING_BUDGET),
        **MODE,
    )
    with Store.open(folder / ARCHIVE, read_only=True) as store:
        updates = [asdict(one) for one in read_updates(store.meta.get(META, ""))]
    return {
        "key": learning_key(model),
        "model": model,
        "state": "learning",
        "updates": updates,
        "seconds": round(time.process_time() - began, 1),
    }


def learning_key(model: str) -> str:
    """Names the row of the updates."""
    return "-".join([*model.split(), "learning", size()])
