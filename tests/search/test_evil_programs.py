"""Programs that want all time and memory: what the grammar admits ends like any other, alone and
through the tools of agents.
"""

import pytest
from fitted import benchmark
from ibrid_bench.attack.programs import EVIL
from ibrid_search.agents.logbook import Logbook
from ibrid_search.agents.tool import call_by_name
from ibrid_search.agents.workbench import Workbench

from ibrid.evaluation.evaluate import evaluate
from ibrid.fit.settings import FitSettings
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.compiling.check import examine
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study

#: How each ends: right at a bound of the grammar, legal with much in it, and the 195 gains that
#: once ran ten times as long as they were allowed, for which the grammar has a bound since.
CHOSEN = {
    "the largest algebraic loop": "ok",
    "14 filters that reach each other through 180 gains": "ok",
    "13 PI controllers, all to all": "illegal",
    "195 gains in one algebraic loop": "illegal",
}
#: Little work: what is asked is whether it ends, not how well it fits.
BRIEF = FitSettings(
    starts=8, kept=1, kept_misfit=1, halving=((4, 1),), restarts=0, hops=0, ipopt_iterations=5
)


@pytest.mark.slow
@pytest.mark.parametrize("what", CHOSEN)
def test_an_evil_program_ends_as_it_must(what: str):
    record = evaluate(EVIL[what](), benchmark(), settings=BRIEF)
    if CHOSEN[what] == "illegal":
        assert record.outcome == "invalid"
        assert record.reasons
    else:
        assert record.outcome == "ok"
        assert (
            0.1 < record.nrmse < 10.0
        )  # gains are no inverter: about as far from the data as nothing is, which is 1


@pytest.mark.slow
def test_evil_programs_end_through_the_tools_of_agents_and_the_next_call_is_answered():
    bench = Workbench(Logbook(Study(benchmark()), fit=BRIEF))
    for what, status in CHOSEN.items():
        answer = call_by_name(
            bench.all, "evaluate_program", {"program": program_text(EVIL[what]())}
        )
        assert answer["status"] == status, what
    answer = call_by_name(
        bench.all, "check_grammar", {"program": program_text(EVIL["the largest algebraic loop"]())}
    )
    assert "error" not in answer


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
