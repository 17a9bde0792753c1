"""A gap that is being sought: answers on the way, an end before everything was tried, one progress;
and a record as the model.
"""

import json
from dataclasses import replace
from functools import cache

import pytest
from ibrid_bench.hidden.case import Case, draw_case
from jsonschema import Draft202012Validator

import ibrid
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import record_at
from ibrid.gap.budget import Budget
from ibrid.gap.datasets.sweep_dataset import SweepDataset
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.gap.refitting.prior import build_prior
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.gap.results.files import gap_json
from ibrid.gap.results.gap import Gap
from ibrid.gap.workflow import find_gap
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE
from ibrid.schemas import schema
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

FEW = tuple(one for one in CATALOGUE if one.id in ("control_delay", "pll_prefilter"))


@cache
def hidden() -> Case:
    """A filter that the model lacks, at few frequencies."""
    options = {"severity": "gross", "noise_db": 60, "points": 1, "frequencies": 6}
    return draw_case("effect", 3, effects=["pll_prefilter:add"], **options)


@pytest.mark.slow
def test_what_is_known_on_the_way_is_passed_on_and_one_share_only_grows(monkeypatch):
    monkeypatch.setattr("ibrid.gap.progress.EVERY", 0.0)
    case, answers, shares = hidden(), list[Gap](), list[float]()

    def told(words: str, share: float) -> None:
        shares.append(share)

    gap = find_gap(
        parse_program(case.program),
        case.sweep,
        case.values,
        catalogue=FEW,
        so_far=answers.append,
        progress=told,
    )
    assert gap.complete
    assert gap.verdict == "named"
    assert answers
    for answer in answers:
        assert not answer.complete
        assert answer.sentence.startswith("So far: ")
        assert not list(
            Draft202012Validator(schema("gap")).iter_errors(
                json.loads(json.dumps(gap_json(answer)))
            )
        )
    assert shares == sorted(shares)
    assert 0.0 < shares[-1] <= 1.0


def test_when_the_effort_is_spent_the_best_so_far_is_the_answer_and_says_so(monkeypatch):
    monkeypatch.setattr("ibrid.gap.budget.EXPERIMENTS", {"low": 1, "normal": 10_000})
    case = hidden()
    gap = find_gap(
        parse_program(case.program), case.sweep, case.values, catalogue=FEW, effort="low"
    )
    assert not gap.complete
    assert gap.verdict == "unexplained"
    assert gap.sentence.startswith("Unfinished: The model does not explain the data")
    assert "no effect" not in gap.sentence
    assert "Stopped after 1 experiments (effort low)" in gap.sentence
    assert not gap.effects
    assert gap_json(gap)["complete"] is False
    assert gap_json(gap)["experiments"] == 1


def test_every_look_and_every_refit_is_an_experiment_whatever_is_known_already(monkeypatch):
    case = hidden()
    diagram, budget = parse_program(case.program), Budget()
    wiring = wire(diagram, VOCABULARY)
    prior = build_prior(case.values, wiring, parameter_table(wiring, "exact"))
    dataset = SweepDataset(estimate_noise(case.sweep), VOCABULARY, prior, FEW, 0, budget=budget)
    given = dataset.fit_given(diagram)
    assert given is not None
    edit = dataset.insertions(given)[0]
    experiments = (
        lambda: dataset.screen_edit(given, edit),
        lambda: dataset.fit_edit(given, edit),
        lambda: dataset.refit_from(given, [{}]),
    )
    for experiment in (*experiments, *experiments):
        before = budget.made
        experiment()
        assert budget.made == before + 1
    before = budget.made
    read = list(
        dataset.fit_other_conventions(given, 0.0)
    )  # nothing is near enough to be refitted, but all are looked at
    assert budget.made > before + len(read)
    monkeypatch.setattr("ibrid.gap.progress.EVERY", 0.0)
    known = list[Gap]()
    spent = [
        find_gap(diagram, case.sweep, case.values, catalogue=FEW, so_far=one).experiments
        for one in (None, known.append)
    ]
    assert known
    assert spent[0] == spent[1] > 20


def test_an_effort_that_there_is_not_is_refused():
    case = hidden()
    with pytest.raises(IbridError, match="effort must be one of low, normal, high, found 'much'"):
        find_gap(parse_program(case.program), case.sweep, case.values, effort="much")


@pytest.mark.slow
def test_a_record_is_a_model_with_its_values():
    case = draw_case("nothing", 2, frequencies=8, points=1)
    given = record_at(parse_program(case.program), case.sweep, case.truth["values"])
    gap = ibrid.find_gap(given, case.sweep, catalogue=FEW)
    assert gap.verdict == "no-gap"
    assert {one.name: one.nominal for one in gap.moved} == pytest.approx(
        next(iter(given.parameters.values()))
    )


def test_a_record_without_one_set_of_values_is_refused():
    case = hidden()
    given = record_at(parse_program(case.program), case.sweep, case.values)
    for broken in (
        replace(given, settings={**given.settings, "parameters": "per-op"}),
        replace(given, parameters={}),
    ):
        with pytest.raises(IbridError):
            ibrid.find_gap(broken, case.sweep)


@pytest.mark.slow
def test_of_many_data_a_few_lead_to_the_minimum_of_all(monkeypatch):
    case = draw_case(
        "effect",
        3,
        effects=["pll_prefilter:add"],
        severity="gross",
        noise_db=60,
        points=4,
        frequencies=60,
    )
    diagram, noise = parse_program(case.program), estimate_noise(case.sweep)
    wiring = wire(diagram, VOCABULARY)
    prior = build_prior(case.values, wiring, parameter_table(wiring, "exact"))
    led = SweepFitter(noise, VOCABULARY, prior, 0).fit(diagram, [{}], draws=8)
    monkeypatch.setattr("ibrid.gap.refitting.sweep_fitter.MANY", 10**6)
    slow = SweepFitter(noise, VOCABULARY, prior, 0).fit(diagram, [{}], draws=8)
    assert led is not None
    assert slow is not None
    assert led.measurement_count == slow.measurement_count == 60 * 4 * 8
    assert led.cost == pytest.approx(
        slow.cost, rel=1e-6
    )  # the same minimum, each to the end of its descent
