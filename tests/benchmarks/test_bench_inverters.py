"""The table of every reference inverter: what is hidden in them, what a row says, and that nothing
is measured twice.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.ledger import Ledger
from ibrid_bench.reference.__main__ import main
from ibrid_bench.reference.hiding import HIDINGS, NOMINAL_ERROR, Hiding, hidden_case, itself
from ibrid_bench.reference.rows import (
    INVERTERS,
    SEARCHES,
    TASKS,
    Effort,
    Task,
    measured,
    nearest_textbooks,
    tasks,
)
from ibrid_bench.reference.tables import NOT_YET, page
from ibrid_bench.search.inverters import inverter
from ibrid_bench.search.scoring import perform
from ibrid_bench.search.trials import BUDGETS, rules_trial

import ibrid
from ibrid.errors import IbridError
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE, insertions
from ibrid.plants.published import BEYOND
from ibrid.structure import compare, structure_hash, violations
from ibrid.structure.editing.drafting import Draft

NAMED = [pytest.param(one, id=f"{one.inverter}: {one.words}") for one in HIDINGS]


# what is hidden


def test_every_inverter_hides_at_least_two_effects_of_the_catalogue():
    assert set(INVERTERS) == {"paper_like", *(plant.name for plant in BEYOND)}
    for name in INVERTERS:
        assert len({one.effect for one in HIDINGS if one.inverter == name}) >= 2
    assert {one.effect for one in HIDINGS} <= {effect.id for effect in CATALOGUE}
    assert len({(one.inverter, one.words) for one in HIDINGS}) == len(HIDINGS)


@each_of("hiding", NAMED)
def test_an_edit_of_the_hidden_effect_leads_from_the_model_to_the_device(hiding: Hiding):
    case = hidden_case(hiding)
    assert violations(case.model) == ()
    device = _device_of(hiding)
    assert not compare(case.model, device).same
    edits = [
        one
        for one in insertions(case.model, VOCABULARY)
        if one.effect == hiding.effect and one.change != "remove"
    ]
    if (
        hiding.effect == "virtual_impedance"
    ):  # the catalogue's has a resistance beside the reactance
        assert any("JMul_omega" in one.where for one in edits)
    else:
        assert any(compare(one.diagram, device).same for one in edits)


def _device_of(hiding: Hiding) -> ibrid.Diagram:
    textbook = ibrid.parse_program(inverter(hiding.inverter).program)
    if not hiding.values:
        return textbook
    draft = Draft(textbook, VOCABULARY)
    hiding.edit(draft)
    draft.tidy()
    return draft.diagram()


def test_nominal_values_are_near_the_true_ones_and_the_same_every_time():
    shifts = []
    for hiding in HIDINGS:
        case, true = hidden_case(hiding), inverter(hiding.inverter).values or {}
        assert hidden_case(hiding).values == case.values
        shifts += [np.log(value / true[name]) for name, value in case.values.items()]
        assert not set(case.values) & set(hiding.values)
    # the standard deviation of 300 draws is known to 4 % of itself
    assert len(shifts) > 300
    assert np.std(shifts) == pytest.approx(NOMINAL_ERROR, rel=0.15)


def test_a_device_that_would_be_unstable_is_refused():
    worse = next(
        one for one in HIDINGS if (one.inverter, one.effect) == ("gfm_dvoc", "control_delay")
    )
    with pytest.raises(
        IbridError, match=r"must be stable to be measured; at p=1,q=0.3 it has a pole"
    ):
        hidden_case(
            Hiding(worse.inverter, worse.effect, worse.words, worse.edit, {"delay.T_d": 1e-4})
        )


def test_without_anything_hidden_the_textbook_program_meets_its_own_device_without_nominal_values():
    case = itself("gfm_droop")
    assert structure_hash(case.model) == structure_hash(ibrid.textbook("gfm_droop"))
    assert case.values == {}
    assert len(case.sweep.points) == 3
    assert case.held_out in case.sweep.names


# rows


@dataclass(frozen=True)
class Named:
    id: str
    indistinguishable_from: tuple[str, ...] = ()


@dataclass(frozen=True)
class Answer:
    """What stands for a Gap."""

    verdict: str
    effects: tuple[Named, ...] = ()
    before: Any = None
    after: Any = None
    sentence: str = "so it is"


def answering(answer: Answer, seen: list | None = None) -> Any:
    def find(diagram, sweep, values, *, holdout_op):
        if seen is not None:
            seen.append((diagram, sweep, values, holdout_op))
        errors = {"nominal": None, "refit": 0.1, "holdout": 0.2}
        return Answer(
            answer.verdict, answer.effects, errors, {**errors, "refit": 1e-6, "holdout": None}
        )

    return find


def gap_row(hiding: Hiding | None, answer: Answer) -> dict[str, Any]:
    name = "gfl_l_filter" if hiding is None else hiding.inverter
    effort = Effort(search=lambda *_: None, folder=Path(), budget=500, find_gap=answering(answer))  # type: ignore[arg-type]
    return measured(Task(name, "gap", 500, hiding), effort)


def test_a_gap_is_right_when_the_hidden_effect_is_named_first_and_alone():
    delay = next(
        one for one in HIDINGS if (one.inverter, one.effect) == ("gfl_l_filter", "control_delay")
    )
    one, other = Named("control_delay", ("command_filter",)), Named("decoupling")
    row = gap_row(delay, Answer("named", (one,)))
    assert (row["right"], row["first"], row["alike"]) == (True, True, ["command_filter"])
    assert (row["before"], row["after"], row["holdout"]) == (0.1, 1e-6, None)
    pair = gap_row(delay, Answer("named", (one, other)))
    assert (pair["right"], pair["first"]) == (False, True)
    assert gap_row(delay, Answer("named", (other, one)))["first"] is False
    assert gap_row(delay, Answer("unexplained"))["right"] is False
    assert gap_row(None, Answer("no-gap"))["right"] is True
    assert gap_row(None, Answer("parameters-only"))["right"] is False
    assert gap_row(None, Answer("no-gap"))["first"] is None


def test_the_fit_of_a_known_structure_and_both_sweeps_of_an_inverter_are_measured():
    effort = Effort(search=lambda *_: None, folder=Path(), budget=500)  # type: ignore[arg-type]
    fit = measured(Task("gfl_l_filter", "fit", 500), effort)
    assert fit["nrmse"] < 1e-9
    assert fit["holdout"] < 1e-9
    assert fit["stable"]
    assert 0 < fit["recovered"] <= fit["of"] == 9
    sweeps = measured(Task("gfl_l_filter", "sweeps", 500), effort)
    # the demands on every reference inverter
    assert sweeps["injected"] < 1e-3
    assert sweeps["program"] < 1e-8
    assert sweeps["states"] == 8


def test_another_budget_is_another_search_and_nothing_else():
    for kind in TASKS:
        one, other = Task("gfm_vsm", kind, 500), Task("gfm_vsm", kind, 100)
        assert (one.key != other.key) == (kind in SEARCHES)
    keys = [task.key for task in tasks(INVERTERS, TASKS, 500)]
    assert len(set(keys)) == len(keys)


# the command


@dataclass(frozen=True)
class Found:
    """What stands for a run of the search."""

    answer_program: str
    best: Any
    evaluations: int = 40
    finished: bool = True
    seconds: float = 3.0
    selection: Any = field(default_factory=dict)
    trajectory: tuple = ((0, 0.9, 0.9), (7, 1e-9, 1e-9))


def finding(seen: list):
    def search(sweep, folder, **options):
        seen.append((sweep, options))
        program = inverter("gfl_l_filter").program
        return Found(program, ibrid.evaluate(ibrid.parse_program(program), sweep))

    return search


def test_every_row_is_printed_and_kept_and_nothing_is_measured_twice(tmp_path, capsys):
    searched: list = []
    asked: list = []
    options = ["--inverter", "gfl_l_filter", "--only", "gap", "--only", "search", "--budget", "40"]
    options += ["--out", str(tmp_path / "out"), "--page", str(tmp_path / "page.md")]

    def run() -> str:
        answer = Answer("named", (Named("control_delay"),))
        assert main(options, search=finding(searched), find_gap=answering(answer, asked)) == 0
        return capsys.readouterr().out

    shown = run()
    number = 1 + sum(one.inverter == "gfl_l_filter" for one in HIDINGS)
    assert (len(asked), len(searched)) == (number, 1)
    assert searched[0][1]["budget"] == 40
    assert len(searched[0][0].points) == 2  # the search never sees the held-out point
    assert shown.count("named") >= number
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    whole = list(tasks(INVERTERS, TASKS, 40))
    assert text.count(NOT_YET) == len(whole) - number - 1
    assert "the hidden effect named first in 1 of 3" in text
    assert "1 of 1 answers come to 1e-3, 1 are found" in text
    again = run()
    assert (len(asked), len(searched)) == (number, 1)
    assert again == shown
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == text


def test_a_row_that_fails_says_so_and_the_others_go_on(tmp_path, capsys):
    def refusing(*_: Any, **__: Any):
        raise IbridError("the model has no response")

    options = ["--inverter", "gfl_l_filter", "--only", "gap", "--out", str(tmp_path / "out")]
    assert (
        main([*options, "--page", str(tmp_path / "page.md")], find_gap=refusing, search=finding([]))
        == 1
    )
    assert capsys.readouterr().out.count("the model has no response") == 4
    assert (tmp_path / "page.md").read_text(encoding="utf-8").count(NOT_YET) == len(
        list(tasks(INVERTERS, TASKS, 1000))
    )


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (["--inverter", "gfm_drop"], "there is no reference inverter called gfm_drop"),
        (["--only", "gaps"], "there is no kind of row called gaps"),
        (["--page", "nowhere/page.md"], "there is no folder"),
    ],
)
def test_wrong_options_are_one_sentence(tmp_path, capsys, wrong, sentence):
    assert main(["--out", str(tmp_path / "out"), *wrong]) == 2
    shown = capsys.readouterr()
    assert sentence in shown.err
    assert shown.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_page_in_the_docs_is_that_of_the_shipped_results():
    docs = Path(__file__).resolve().parents[2] / "docs"
    rows = Ledger(docs / "measured" / "inverters").rows
    whole = list(tasks(INVERTERS, TASKS, BUDGETS["inverters"]))
    assert (docs / "inverters_results.md").read_text(encoding="utf-8") == page(whole, rows)
    assert set(rows) <= {task.key for task in whole}


def test_a_search_may_begin_with_the_textbook_diagrams_of_the_inverters_that_are_most_alike(
    tmp_path, capsys
):
    starts = nearest_textbooks("gfl_l_filter")
    assert {one.inverter for one in starts} == set(INVERTERS) - {"gfl_l_filter", "parallel_gfl_gfm"}
    assert [one.nrmse for one in starts] == sorted(one.nrmse for one in starts)
    for kind, start in zip(("nearest", "second"), starts, strict=False):
        assert ibrid.evaluate(start.program, inverter("gfl_l_filter").sweep).nrmse == pytest.approx(
            start.nrmse
        )
        searched: list = []
        out = tmp_path / kind
        assert (
            main(
                ["--inverter", "gfl_l_filter", "--only", kind, "--out", str(out)],
                search=finding(searched),
            )
            == 0
        )
        ((_, asked),) = searched
        assert structure_hash(asked["start"]) == structure_hash(start.program)
        (row,) = Ledger(out).rows.values()
        assert (row["start"], row["success"]) == (start.inverter, True)
        assert f"`{start.inverter}`" in capsys.readouterr().out


def test_a_search_that_was_made_before_is_read_and_not_made_again(tmp_path):
    searched: list = []
    options = ["--inverter", "gfl_l_filter", "--only", "search", "--out", str(tmp_path / "out")]
    trial = rules_trial("gfl_l_filter", BUDGETS["inverters"])
    Ledger(tmp_path / "made").add(perform(trial, tmp_path / "run", search=finding([]), workers=1))
    assert main([*options, "--searches", str(tmp_path / "made")], search=finding(searched)) == 0
    assert searched == []
    (row,) = Ledger(tmp_path / "out").rows.values()
    assert (row["success"], row["seconds"], row["evaluations"]) == (True, 3.0, 40)
    assert (
        main(
            [*options, "--budget", "20", "--searches", str(tmp_path / "made")],
            search=finding(searched),
        )
        == 0
    )
    assert len(searched) == 1  # another budget is another search
