"""Legal programs that want all time and memory end by the limit of their evaluation, alone, through the tools and on workers."""

import pytest
from fitted import benchmark
from ibrid_bench.attack.programs import EVIL
from ibrid_search.logbook import Logbook
from ibrid_search.tool import call_by_name
from ibrid_search.workbench import Workbench

from ibrid.evaluation.evaluate import evaluate
from ibrid.fit.settings import FitSettings
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.check import examine
from ibrid.structure.program import program_text
from ibrid.study import Study

#: What is right at a bound of the grammar, and the 195 gains that once ran ten times as long as they were allowed.
CHOSEN = ("the largest algebraic loop", "13 PI controllers, all to all", "195 gains in one algebraic loop")
BRIEF = FitSettings(seconds=1.0)


@pytest.mark.parametrize("what", CHOSEN)
def test_an_evil_program_ends_by_its_limit(what: str):
    record = evaluate(EVIL[what](), benchmark(), settings=BRIEF)
    assert record.outcome in ("invalid", "ok", "failed", "timeout")


def test_evil_programs_end_through_the_tools_of_agents_and_the_next_call_is_answered():
    bench = Workbench(Logbook(Study(benchmark()), fit=BRIEF))
    for what in CHOSEN:
        answer = call_by_name(bench.all, "evaluate_program", {"program": program_text(EVIL[what]())})
        assert answer["status"] in ("illegal", "ok", "failed", "timeout"), what
    assert call_by_name(bench.all, "check_grammar", {"program": program_text(EVIL[CHOSEN[0]]())})


def test_what_lies_beyond_a_bound_is_illegal_and_said_in_a_sentence():
    beyond = (
        "195 gains in one algebraic loop",
        "one module more in a loop than may be",
        "one free parameter more than may be",
    )
    for what in beyond:
        violations = examine(EVIL[what](), VOCABULARY)[0]
        assert violations, what
        assert "\n" not in str(violations[0])
