"""An answer held to a schema: what is asked of a server, what it refuses and remembers, and the
edit that comes out.
"""

import json
import re

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_search.chat import answer_forms
from ibrid_search.chat.answer_forms import gbnf
from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.edits import apply_edit
from ibrid_search.evaluation.judging import verdict_of
from ibrid_search.proposal import Context, Evaluated
from ibrid_search.proposers.edit_fields import blocks_of, edit_schema, read_fields
from ibrid_search.proposers.language_model import LanguageModel
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.edit_screening import ScreeningFit
from ibrid_search.step import Status
from jsonschema import ValidationError, validate
from scripted_server import refuses, says, scripted

import ibrid
from ibrid.errors import IbridError
from ibrid.structure import parse_program, program_text
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.study import Study

pytest.importorskip(
    "openai", reason="the client of chat servers needs openai; pip install 'ibrid[llm]'"
)

FIELDS = {
    "step": 0,
    "remove": ['g.connect("gain.out", "plant.u_r")'],
    "add": [{"kind": "LPF1_dq", "name": "smooth"}],
    "connect": [
        {"source": "gain.out", "target": "smooth.in_"},
        {"source": "smooth.out", "target": "plant.u_r"},
    ],
}
CHANGE = "a low-pass behind the gain"
ANSWER = json.dumps({"change": CHANGE, "edit": FIELDS})
NAIVE = program_text(ibrid.textbook("naive"))


@pytest.fixture
def context(monkeypatch) -> Context:
    monkeypatch.setattr(answer_forms, "_REFUSED", {})
    monkeypatch.setattr(Context, "lacks", lambda self, number=1: [])
    return Context(
        Study(benchmark()), Evaluated(0, ibrid.textbook("naive"), evaluated("naive", restarts=0))
    )


def asked(context: Context, script, number: int = 1, **settings):
    chat = ChatServer("small", script.url, timeout=300.0, retries=0, **settings)
    return [
        LanguageModel([(chat, 1.0)]).propose(context, np.random.default_rng(k))
        for k in range(number)
    ]


def test_fields_that_keep_to_the_schema_are_an_edit_of_the_chosen_program(context):
    schema = edit_schema([context.parent], context.study.kinds)
    validate(json.loads(ANSWER), schema)
    edit = blocks_of(FIELDS, context.parent)
    text = apply_edit(edit, NAIVE)
    lines = [line.strip() for line in text.splitlines()]
    assert FIELDS["remove"][0] not in lines
    assert {'g.add("LPF1_dq", "smooth")', 'g.connect("smooth.out", "plant.u_r")'} < set(lines)
    assert ibrid.parse_program(text)


@pytest.fixture
def ranked(context, monkeypatch) -> list[ScreeningFit]:
    """A diagnosis of two edits."""
    words = {
        "a sign at the gain": ("gain", "Negate_dq"),
        "a filter at the gain": ("gain", "LPF1_dq"),
    }
    found = [
        ScreeningFit(
            CandidateEdit(replaced(context.parent.diagram, *edit), told, "filters", {}), 0.5, 5, 0.0
        )
        for told, edit in words.items()
    ]
    monkeypatch.setattr(Context, "lacks", lambda self, number=1: found)
    return found


def replaced(diagram: Diagram, name: str, kind: str) -> Diagram:
    """A diagram with another kind of module in the place of one."""
    return parse_program(
        program_text(diagram).replace(f'g.add("Gain_dq", "{name}")', f'g.add("{kind}", "{name}")')
    )


@pytest.mark.slow
def test_an_edit_of_the_diagnosis_is_taken_by_its_number(context, ranked):
    said = {"change": "the filter is what is missing", "edit": {"take": 2}}
    with scripted(says(json.dumps(said))) as script:
        (proposal,) = asked(context, script)
    schema = script.requests[0]["response_format"]["json_schema"]["schema"]
    validate(said, schema)
    validate(json.loads(ANSWER), schema)
    for wrong in ({"take": 0}, {"take": 3}, {**FIELDS, "take": 1}):
        with pytest.raises(ValidationError):
            validate({"change": "", "edit": wrong}, schema)
    assert (
        "2. a filter at the gain: 0.5, 5 free parameters"
        in script.requests[0]["messages"][1]["content"]
    )
    assert apply_edit(proposal.edit, NAIVE) == program_text(ranked[1].edit.diagram)
    assert proposal.note == "a filter at the gain (the filter is what is missing)"
    assert (proposal.parent, proposal.usage["taken"]) == (0, True)


@pytest.mark.nightly
@pytest.mark.parametrize("take", [0, 3, -1, 2.5, "2", None])
def test_any_other_number_is_no_edit_unless_one_is_written_beside_it(context, ranked, take):
    alone, beside = ({"change": "", "edit": {**own, "take": take}} for own in ({}, FIELDS))
    with scripted(says(json.dumps(alone)), says(json.dumps(beside))) as script:
        none, own = asked(context, script, 2)
    assert verdict_of(none, context).status is Status.NO_EDIT
    assert own.edit == blocks_of(FIELDS, context.parent)


@pytest.mark.slow
def test_a_model_whose_own_edits_are_none_is_held_to_the_diagnosis(context, ranked):
    none, good = json.dumps({"change": "", "edit": {**FIELDS, "connect": []}}), ANSWER
    take = json.dumps({"change": "", "edit": {"take": 1}})
    script = [none, none, good, none, take, none, none, take]
    with scripted(*map(says, script)) as server:
        chat = ChatServer("small", server.url, timeout=300.0, retries=0)
        proposer = LanguageModel([(chat, 1.0)])
        found = [proposer.propose(context, np.random.default_rng(k)) for k in range(len(script))]
    assert [verdict_of(one, context).status is Status.PENDING for one in found] == [
        one in (good, take) for one in script
    ]
    schemas = [
        one["response_format"]["json_schema"]["schema"]["properties"]["edit"]
        for one in server.requests
    ]
    assert ["anyOf" in one for one in schemas] == [True] * 7 + [False]
    assert [*schemas[-1]["properties"]] == ["take"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "place"), [("CHANGE: a sign\n\nTAKE 1", 0), ("I would do this.\n**TAKE 2**\n", 1)]
)
def test_an_edit_of_the_diagnosis_is_taken_in_a_line_of_text(context, ranked, text, place):
    with scripted(says(text)) as script:
        (proposal,) = asked(context, script, form="text")
    assert "`TAKE n`" in script.requests[0]["messages"][0]["content"]
    assert apply_edit(proposal.edit, NAIVE) == program_text(ranked[place].edit.diagram)


@pytest.mark.slow
def test_blocks_in_a_text_go_before_a_number_in_it(context, ranked):
    text = "CHANGE: a filter\nTAKE 1\n" + blocks_of(FIELDS, context.parent)
    with scripted(says(text)) as script:
        (proposal,) = asked(context, script, form="text")
    assert apply_edit(proposal.edit, NAIVE) == apply_edit(blocks_of(FIELDS, context.parent), NAIVE)


@pytest.mark.slow
def test_a_server_that_takes_a_schema_is_asked_with_it_alone(context):
    with scripted(says(ANSWER)) as script:
        (proposal,) = asked(context, script)
    assert verdict_of(proposal, context).status is Status.PENDING
    assert (proposal.parent, proposal.note, proposal.usage["form"]) == (0, CHANGE, "schema")
    (request,) = script.requests
    validate(json.loads(ANSWER), request["response_format"]["json_schema"]["schema"])
    assert "tools" not in request
    assert "`remove` its lines" in request["messages"][0]["content"]
    assert "SEARCH" not in request["messages"][0]["content"]


@pytest.mark.slow
def test_what_a_server_refuses_is_remembered_and_the_next_way_is_asked_for(context):
    call = {"id": "1", "function": {"name": "submit_edit", "arguments": ANSWER}}
    no = refuses(400, "response_format is not supported")
    with scripted(no, says(None, tool_calls=[call]), says(None, tool_calls=[call])) as script:
        found = asked(context, script, 2)
    assert [one.usage["form"] for one in found] == ["tool", "tool"]
    assert [("response_format" in one, "tool_choice" in one) for one in script.requests] == [
        (True, False),
        (False, True),
        (False, True),
    ]


@pytest.mark.slow
def test_a_server_that_takes_none_is_asked_for_text_and_never_again_for_a_form(context):
    text = "CHANGE: a filter\n" + blocks_of(FIELDS, context.parent)
    with scripted(*[refuses(422, "unknown field")] * 3, says(text)) as script:
        found = asked(context, script, 3)
    assert [verdict_of(one, context).status for one in found] == [Status.PENDING] * 3
    assert [
        sorted({"response_format", "tools", "grammar"} & {*one}) for one in script.requests
    ] == [
        ["response_format"],
        ["tools"],
        ["grammar"],
        [],
        [],
        [],
    ]
    assert "SEARCH" in script.requests[-1]["messages"][0]["content"]


@pytest.mark.slow
def test_a_form_that_is_taken_without_a_word_and_not_kept_to_is_not_asked_for_again(context):
    with scripted(says("I would add a filter."), says(ANSWER)) as script:
        first, second = asked(context, script, 2)
    assert first.usage["form"] == "schema"
    assert "tools" in script.requests[1]
    assert verdict_of(second, context).status is Status.PENDING


@pytest.mark.slow
def test_parameters_that_a_server_does_not_know_are_left_out_from_then_on(context):
    no = refuses(
        400,
        "Unsupported parameter: seed, reasoning_effort; use max_completion_tokens and not "
        "max_tokens",
    )
    with scripted(no, says("x")) as script:
        asked(context, script, 2, form="text", effort="high", extra={"top_p": 0.9})
    assert {"seed", "reasoning_effort", "max_tokens", "top_p"} <= {*script.requests[0]}
    for request in script.requests[1:]:
        assert not {"seed", "reasoning_effort", "max_tokens"} & {*request}
        assert (request["max_completion_tokens"], request["top_p"]) == (16_384, 0.9)
    assert len(script.requests) == 3


@pytest.mark.parametrize("number", [0, 2])
def test_a_grammar_has_a_rule_for_all_that_it_names_and_says_what_the_schema_says(context, number):
    schema = edit_schema([context.parent], context.study.kinds, number)
    text = gbnf(schema)
    rules = dict(line.split(" ::= ", 1) for line in text.splitlines())
    bare = {
        name: re.sub(r'"(?:[^"\\]|\\.)*"|\[(?:[^\]\\]|\\.)*\]|\{[\d,]+\}', " ", rule)
        for name, rule in rules.items()
    }
    assert {word for rule in bare.values() for word in re.findall(r"[a-z][a-z-]*", rule)} <= {
        *rules
    }
    for kind in context.study.kinds:
        assert json.dumps(json.dumps(kind.name)) in rules["root-edit-add-item-kind"]
    assert ("root-edit-take" in rules) == bool(number)


@pytest.mark.parametrize("edit", ['{"remove": 1}', '{"remove": [], "add": []}', "[]", "1"])
def test_fields_that_say_no_edit_are_none(edit):
    assert read_fields(f'{{"edit": {edit}}}') is None


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"remove": [], "add": [], "connect": []}', "[" * 100_000]
)
def test_what_is_not_these_fields_is_none(text):
    assert read_fields(text) is None


@pytest.mark.slow
def test_hostile_fields_are_no_more_than_text_that_the_grammar_refuses(context, tmp_path):
    harm = f'"); __import__("os").system("touch {tmp_path / "harm"}"); ("'
    fields = {
        **FIELDS,
        "add": [{"kind": harm, "name": harm}, 5],
        "connect": [{"source": harm}, None],
        "remove": [1, harm],
    }
    with scripted(says(json.dumps({"change": harm, "edit": fields}))) as script:
        (proposal,) = asked(context, script)
    assert verdict_of(proposal, context).status in (Status.UNREADABLE, Status.ILLEGAL)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("settings", "why"),
    [({"form": "json"}, "has the form auto"), ({"extra": {"model": "x"}}, "is not free")],
)
def test_settings_of_a_request_without_a_meaning_are_refused(settings, why):
    with pytest.raises(IbridError, match=why):
        ChatServer("small", **settings)
