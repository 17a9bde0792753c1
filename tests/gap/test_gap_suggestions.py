"""Where something is missing that the catalogue cannot name: suggested edits, weighed by the tests
of a named effect.
"""

import pytest
from ibrid_bench.hidden.case import Case, draw_case
from ibrid_search.proposers.choose import Proposers
from ibrid_search.proposers.rules import Rules
from ibrid_search.recursion.suggesting import MANY, suggestions_of, told
from scripted_server import says, scripted
from sharing import shared

from ibrid.gap.results.files import gap_json
from ibrid.gap.results.gap import Gap
from ibrid.gap.results.suggested_edits import Suggestion, SuggestionRequest, low_order_blocks
from ibrid.gap.workflow import find_gap
from ibrid.report.pages.gap_page import gap_page
from ibrid.report.texts.gap_text import gap_text
from ibrid.structure.diagrams.program import parse_program, program_text

FILTERED = (
    '    g.add("LPF1", "sensor")\n    g.connect("plant.e_q", "sensor.in_")\n    '
    'g.connect("sensor.out", "pll.e_q")\n'
)


@shared
def case() -> Case:
    """A device with a filter before its PLL; the catalogue is kept from knowing of such a thing."""
    return draw_case("effect", 3, effects=["pll_prefilter:add"], severity="gross", noise_db=60)


def build_event_problem(*suggest) -> Gap:
    return find_gap(
        parse_program(case().program), case().sweep, case().values, catalogue=(), suggest=suggest
    )


@shared
def plain() -> Gap:
    return build_event_problem(low_order_blocks)


def questions() -> list[SuggestionRequest]:
    """What a suggester was asked, one entry."""
    heard: list[SuggestionRequest] = []

    def listen(question: SuggestionRequest) -> list[Suggestion]:
        heard.append(question)
        return []

    build_event_problem(listen)
    return heard


@pytest.mark.nightly
def test_a_block_of_low_order_at_the_right_place_passes_and_the_verdict_stays():
    gap = plain()
    assert gap.verdict == "located-unnamed", gap.sentence
    assert gap.effects == ()
    first = gap.suggested[0]
    assert first.reason == ""
    assert "LPF1" in first.words
    assert first.chi2_per_dof < 1.5 < first.before
    assert first.held_out["after"]["frequencies"] < 1.5 < first.held_out["before"]["frequencies"]
    assert gap.program == program_text(parse_program(gap.given))


@pytest.mark.nightly
def test_suggestions_that_fail_say_which_test():
    reasons = {one.reason for one in plain().suggested}
    assert "" in reasons
    assert reasons - {""} <= {
        "does not pay",
        "does not fit as well as the noise allows",
        "unstable",
        "has no response",
    }
    assert len(reasons) > 1


@pytest.mark.nightly
def test_an_illegal_suggestion_is_refused_and_a_repeated_one_is_weighed_once():
    given = program_text(parse_program(case().program))
    broken = parse_program(given + '    g.add("LPF1", "loose")\n')

    def suggest(question: SuggestionRequest) -> list[Suggestion]:
        return [
            Suggestion(broken, "a loose block", "somebody"),
            Suggestion(broken, "the same again", "somebody else"),
        ]

    (one,) = build_event_problem(suggest).suggested
    assert one.words == "a loose block"
    assert one.reason.startswith("not legal: ")


@pytest.mark.nightly
def test_whoever_suggests_is_told_the_places_and_the_measured_transfer():
    (question,) = questions()
    assert all(one.adequate for one in question.ports)
    words = told(question.ports[0])
    assert question.ports[0].port.words in words
    assert words.count(" Hz: ") == 12


@pytest.mark.nightly
def test_the_rules_of_the_search_find_the_filter():
    gap = build_event_problem(suggestions_of(Rules(), MANY))
    passed = [one for one in gap.suggested if not one.reason]
    assert passed, [one.words for one in gap.suggested]
    assert {one.source for one in gap.suggested} == {"rules"}


@pytest.mark.nightly
def test_a_language_model_suggests_and_can_do_no_harm(monkeypatch):
    pytest.importorskip(
        "openai", reason="the client of chat servers needs openai; pip install 'ibrid[llm]'"
    )
    monkeypatch.setenv("OPENAI_API_KEY", "none")
    line = next(one for one in case().program.splitlines() if '"pll.e_q"' in one)
    good = (
        f"CHANGE: a filter before the PLL\n<<<<<<< SEARCH\n{line}\n=======\n{FILTERED}>>>>>>> "
        "REPLACE"
    )
    with scripted(says("import os; os.remove('/')"), says(good)) as script:
        ((model, _),) = Proposers("llm", [f"any@{script.url}"]).weighted()
        gap = build_event_problem(suggestions_of(model, 2))
    passed = [one for one in gap.suggested if not one.reason]
    assert [one.words for one in passed] == ["a filter before the PLL"]
    assert "unknown transfer" in str(script.requests[0])


@pytest.mark.nightly
def test_page_terminal_and_json_show_suggestions_as_a_lead_and_not_as_a_finding():
    gap = plain()
    words = " ".join(gap_text(gap).split())
    assert "a lead, not a finding" in words
    assert gap.suggested[0].words in words
    page = gap_page(gap)
    assert "What it might be" in page
    assert "passes all tests" in page
    data = gap_json(gap)
    assert data["suggested"][0]["reason"] == ""
    assert data["effects"] == []


@pytest.mark.parametrize("options", [["--suggest", "oracle"], ["--suggest", "llm"]])
def test_an_unknown_suggester_and_one_without_a_model_are_refused_in_a_sentence(
    options, tmp_path, capsys
):
    from ibrid.cli import main

    assert main(["gap", "gfl", "paper_like", "--out", str(tmp_path), *options]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "--proposer" not in message
