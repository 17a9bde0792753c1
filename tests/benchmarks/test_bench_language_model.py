"""The benchmark of small language models: its questions are those of a search, its ends those of a
search, its page its rows.
"""

import importlib.util
import json
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from ibrid_bench.language_model import __main__ as program
from ibrid_bench.language_model.answering import SCHEMA, SETTINGS, STATES, WAYS, answered, cases
from ibrid_bench.language_model.page import page
from ibrid_bench.language_model.questions import INVERTERS, PLACES, Question, questions
from ibrid_bench.ledger import NAME, Ledger
from ibrid_policy import smollm2
from ibrid_policy.interface import Sampled
from ibrid_search.edits import edit_between
from ibrid_search.proposers.language_model import read_answer
from ibrid_search.running import search
from scripted_search import context_of
from scripted_server import says, scripted

import ibrid

TORCH = all(importlib.util.find_spec(one) is not None for one in ("torch", "transformers"))
needs_torch = pytest.mark.skipif(
    not TORCH, reason="language models need torch and transformers; make setup-llm"
)
DOCS = Path(__file__).resolve().parents[2] / "docs"
NAIVE = ibrid.program_text(ibrid.textbook("naive"))
STIFFER, SOFTER = (NAIVE.replace('"gain"', f'"gain", k={k}', 1) for k in (0.3, 0.5))
#: What a model may say to the naive program, and what a search calls it.
REPLIES = {
    "I do not know.": "no edit",
    "": "no answer",
    edit_between(NAIVE, STIFFER): "pending",
    edit_between(NAIVE, SOFTER): "duplicate",
    edit_between(STIFFER, NAIVE): "no match",
    edit_between(NAIVE, NAIVE.replace("Gain_dq", "PI_da")): "illegal",
}


#: An edit that keeps to the schema of a server.
FIELDS = json.dumps(
    {
        "change": "a low-pass behind the gain",
        "edit": {
            "step": 0,
            "remove": ['g.connect("gain.out", "plant.u_r")'],
            "add": [{"kind": "LPF1_dq", "name": "smooth"}],
            "connect": [
                {"source": "gain.out", "target": "smooth.in_"},
                {"source": "smooth.out", "target": "plant.u_r"},
            ],
        },
    }
)


class Talker:
    """Says `REPLIES` one after the other; a token is the number of a reply.

    In the place of a `TextPolicy`.
    """

    name, pad, end = "talker", 0, 0

    def __init__(self, *_, **__):
        self.constrained = True

    def prompt(self, context):
        return [0] * 7

    def model(self):
        return None

    def masks(self, prompt, tokens, context):
        return None

    def sample(self, prompts, contexts, number, seed):
        return [[Sampled((one % len(REPLIES),), (0.0,)) for one in range(number)]]

    def proposal(self, sampled, context):
        return read_answer(list(REPLIES)[sampled.tokens[0]], {}, "talker")


def question() -> Question:
    """The naive start, with `SOFTER` known."""
    context = context_of(ibrid.textbook("naive"))
    study = context.study
    known = {study.examined(ibrid.parse_program(SOFTER), SOFTER).hash}
    return Question("paper_like", 1, replace(context, seen=known.__contains__))


def test_questions_are_those_of_a_search_with_what_it_had_met_by_then():
    def short(*words, **options):
        return search(*words, **{**options, "budget": 7})

    first, third = questions("paper_like", short, (1, 3))
    assert first.context.parent.step == 0
    assert (first.place, third.place) == (1, 3)
    study, parent = first.context.study, first.context.parent.diagram
    start = study.examined(parent, ibrid.program_text(parent)).hash
    assert first.context.seen(start)
    assert third.context.seen(start)
    assert not first.context.seen("another")
    assert len(questions("paper_like", short, (1, 500))) == 1


@needs_torch
def test_an_answer_ends_as_it_would_in_a_search(monkeypatch):
    monkeypatch.setattr(
        "ibrid_bench.language_model.answering.SETTINGS", replace(SETTINGS, group=len(REPLIES))
    )
    policy, (case, *_) = Talker(), cases("talker 0")
    row = answered(case, question(), policy)
    assert [one["status"] for one in row["answers"]] == list(REPLIES.values())
    assert not policy.constrained
    assert row["question_tokens"] == 7


def test_every_question_is_asked_in_both_ways_before_and_after_learning_and_of_a_server_once():
    found = list(cases("talker 0"))
    number = (len(STATES) * len(WAYS) + 1) * len(INVERTERS) * len(PLACES)
    assert len({one.key for one in found}) == len(found) == number
    assert all(one.state == STATES[0] for one in found if one.way == SCHEMA)
    states = [one.state for one in found]
    assert states == sorted(states, key=STATES.index)  # the weights change once


@needs_torch
def test_nothing_is_asked_twice_and_the_page_says_what_came_of_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("ibrid_policy.learning.text_policy.TextPolicy", Talker)
    heard = []

    def two(name, _):
        heard.append(name)
        return [replace(question(), place=one) for one in PLACES]

    @contextmanager
    def serving(folder, *, longest):
        with scripted(*[says("I do not know."), says(FIELDS)] * 50) as script:
            yield script.url

    monkeypatch.setattr(program, "serving", serving)
    monkeypatch.setattr(program, "questions", two)
    (tmp_path / "model").mkdir()
    asked = ["--model", str(tmp_path / "model"), "--before", "--out", str(tmp_path / "out")]
    assert program.main(asked) == 0
    assert heard == list(INVERTERS)
    assert program.main(asked) == 0
    assert heard == list(INVERTERS)
    rows = Ledger(tmp_path / "out").rows
    assert len(rows) == (len(WAYS) + 1) * len(INVERTERS) * len(PLACES)
    text = (tmp_path / "out" / "language_model_results.md").read_text(encoding="utf-8")
    # of four answers the third alone is valid; Wilson's interval of 6 of 24 by hand
    assert "as it is, free: 6/24 25% (12-45) of the answers are valid" in text
    # of a server's four the second and the fourth, by turns
    assert "as it is, schema: 12/24 50% (31-69) of the answers are valid" in text
    assert "after learning" not in text
    assert "written:" in capsys.readouterr().out


def test_the_page_that_ships_is_that_of_its_rows():
    rows = Ledger(DOCS / "measured" / "language_model").rows.values()
    assert (DOCS / "language_model_results.md").read_text(encoding="utf-8") == page(rows)
    assert (DOCS / "measured" / "language_model" / NAME).is_file()


def test_without_rows_the_page_says_so():
    assert "Nothing is measured yet." in page([])


def test_a_folder_without_a_model_is_one_sentence(tmp_path, capsys):
    assert program.main(["--model", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "holds no model" in capsys.readouterr().err


def test_a_model_that_cannot_be_converted_names_what_is_missing(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(smollm2, "NEEDED", ("json", "no_such_package"))
    assert smollm2.main() == 2
    assert capsys.readouterr().err == "smollm2: SmolLM2 needs no_such_package; make setup-llm\n"
    (tmp_path / "ibrid" / "smollm2-135m-instruct").mkdir(
        parents=True
    )  # made before: nothing is needed
    assert smollm2.main() == 0
    assert capsys.readouterr().out == f"{tmp_path / 'ibrid' / 'smollm2-135m-instruct'}\n"
