"""The engineer's question: what it tells, that it stays short and never repeats, and that the model
chooses what it edits.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_search.chat.chat import Answer, estimated_tokens, prompt_text
from ibrid_search.edits import edit_between
from ibrid_search.language_models.engineer_question import engineer_question
from ibrid_search.language_models.record_view import polar
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.proposers.language_model import LanguageModel, placed, read_answer
from ibrid_search.step import Status, Step
from scripted_search import NAIVE, PLAIN, ScriptedEvaluator, ended, fixed, steps_of

import ibrid
from ibrid.errors import IbridError
from ibrid.structure import program_text
from ibrid.study import Study

ROOM = 100_000


def candidate(name: str, step: int) -> Evaluated:
    return Evaluated(step, ibrid.textbook(name), evaluated(name, restarts=0))


def context(name: str = "gfl_exact", **changes) -> Context:
    return Context(Study(benchmark()), candidate(name, 5), **changes)


def said(found: Context, limit_tokens: int | None = ROOM) -> str:
    return "\n\n".join(
        str(one["content"]) for one in engineer_question(found, limit_tokens=limit_tokens)
    )


def edit_of(one: Evaluated) -> str:
    """An edit that fits no other program: it takes hold of a comment-free line with a value of its
    own.
    """
    text = program_text(one.diagram)
    return edit_between(
        text, text.replace('g.add("LCL", "plant")', 'g.add("LCL", "plant", R_F=0.004)')
    )


@pytest.mark.nightly
def test_data_record_and_diagnosis_are_told():
    question = context()
    text, point = said(question), benchmark().points[0]
    impedance = -np.linalg.inv(point.admittance[0])
    assert f"{point.frequency[0]:.3g}: {abs(impedance[0, 0]):.3g}/" in text
    assert "- the angle has nearly settled at 5 Hz" in text
    assert program_text(question.parent.diagram) in text
    (best, *_) = question.lacks(8)
    assert f"1. {best.edit.description}: {best.error:.3g}, {best.free} free parameters" in text
    met = replace(question, seen=question.study.hash_of(best.edit.diagram).__eq__)
    assert f"1. {best.edit.description}: {best.error:.3g}" not in said(met)


@pytest.mark.nightly
def test_where_one_unknown_transfer_explains_most_is_told_with_that_transfer():
    question = context()
    text, left = said(question), question.parent.record.misfit["chi2_per_dof"]
    assert 0 < len(question.ports) <= 3
    for fit in question.ports:
        assert fit.chi2_per_dof < left / 4
        seen = np.flatnonzero(fit.deviation < np.abs(fit.transfer) / 2)
        hertz, value = fit.frequency[seen[0]], fit.transfer[seen[0]]
        assert (
            f"- {fit.port.name} ({fit.port.words}): {fit.chi2_per_dof:.3g}; {polar(value)} at "
            f"{hertz:.3g} Hz" in text
        )
    assert context("naive").ports == ()
    assert "unknown transfer" not in said(context("naive"))


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["gfm_droop"])
def test_a_question_has_at_most_six_thousand_tokens_with_data_diagnosis_and_history(name: str):
    tried = tuple(
        Step(k, 5, note="a filter " * 20, status=Status.NO_MATCH, reason="no such line " * 20)
        for k in range(20)
    )
    question = context(
        name, best=(candidate("gfl", 3), candidate("gfl_pll_filter", 4)), recent=tried
    )
    messages = engineer_question(question, limit_tokens=6_000)
    assert estimated_tokens(prompt_text(messages)) <= 6_010
    text = prompt_text(messages)
    for heading in (
        "# The data",
        "# Impedance",
        "# The best program",
        "# Its record",
        "# Diagnosis",
        "# The last steps",
    ):
        assert heading in text
    with pytest.raises(IbridError, match="the limit is 2000"):
        engineer_question(question, limit_tokens=2_000)


@pytest.mark.nightly
def test_a_program_that_needs_more_is_asked_about_in_the_shortest_form_where_nobody_sets_a_limit(
    monkeypatch,
):
    monkeypatch.setattr("ibrid_search.language_models.engineer_question.TOKENS", 2_000)
    text = said(context(), None)
    assert "# Impedance" in text
    assert estimated_tokens(text) > 2_000


@pytest.mark.slow
def test_the_model_chooses_the_step_that_it_edits():
    question = context(best=(candidate("gfl", 3), candidate("gfl_pll_filter", 4)))
    edit = edit_of(question.best[1])
    answer = f"CHANGE: a value\nEDIT STEP 4\n{edit}"
    assert placed(read_answer(answer, {}, "small"), question).parent == 4
    assert (
        placed(read_answer(edit, {}, "small"), question).parent == 5
    )  # it fits the parent too, which comes first


@pytest.mark.slow
def test_an_edit_that_fits_another_program_alone_is_applied_there():
    question = context("naive", best=(candidate("gfl", 3),))
    gfl = program_text(ibrid.textbook("gfl"))
    edit = edit_between(gfl, gfl.replace('g.add("PI", "q_loop"', 'g.add("LPF1", "q_loop"'))
    assert placed(read_answer(edit, {}, "small"), question).parent == 3


def test_a_whole_program_is_taken_as_the_edit_that_leads_to_it():
    question = context("naive")
    for text in (
        f"CHANGE: all of it\n```python\n{program_text(ibrid.textbook('gfl'))}```",
        program_text(ibrid.textbook("gfl")),
    ):
        proposal = placed(read_answer(text, {}, "small"), question)
        assert proposal.edit == edit_between(NAIVE, program_text(ibrid.textbook("gfl")))
        assert proposal.parent == 5


class Asked:
    """Notes its questions; edits step 0 whatever it is asked, then says nothing useful."""

    name = "asked"

    def __init__(self) -> None:
        self.questions: list[str] = []

    def complete(self, messages, *, tools=None, rng_seed=0) -> Answer:
        self.questions.append(prompt_text(messages))
        turn = len(self.questions)
        if turn % 3 == 2:
            return Answer("I do not know")
        return Answer(f"CHANGE: gain {turn}\nEDIT STEP 0\n{edit_between(NAIVE, fixed(turn))}")


@pytest.mark.nightly
def test_in_a_run_no_question_is_asked_twice_and_the_chosen_parent_is_kept(tmp_path: Path):
    chat = Asked()
    law = ScriptedEvaluator(lambda program: 0.5 if program != NAIVE else 0.9, lambda program: True)
    ended(
        tmp_path / "a",
        proposers=[(LanguageModel([(chat, 1.0)]), 1.0)],
        budget=8,
        settings=PLAIN,
        evaluator=law,
    )
    assert len(set(chat.questions)) == len(chat.questions) > 8
    fitted = [step for step in steps_of(tmp_path / "a")[1:] if step.status is Status.OK]
    assert {step.parent for step in fitted} == {0}
    assert "(step 0)" not in chat.questions[-1]  # it was asked about the best, which is a child
