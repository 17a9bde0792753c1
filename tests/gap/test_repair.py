"""A repair that began with a wrong edit ends with the right ones."""

from types import SimpleNamespace
from typing import Any

import pytest
from ibrid_bench.hidden.case import draw_case

from ibrid.gap.datasets.sweep_dataset import SweepDataset
from ibrid.gap.delay_forms import find_lost_forms
from ibrid.gap.refitting.model import Model
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.gap.refitting.prior import build_prior
from ibrid.gap.repair import RepairState, eliminate_backward, rank_trials
from ibrid.gap.results.sweep_gap import _select_reported_model
from ibrid.gap.results.verdict import Findings, net_edits
from ibrid.measurement.conventions.labels import Convention
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE
from ibrid.parts.editing.practice import Insertion
from ibrid.parts.editing.view import Change
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

FEW = tuple(
    one for one in CATALOGUE if one.id in ("power_filter", "pll_prefilter", "reference_feedforward")
)
#: Of a model of which the edits alone are asked.
UNFITTED: Any = SimpleNamespace(parameter_count=0)
TRUE = {("power_filter", "remove"), ("pll_prefilter", "remove")}


def edits_of(model: Model) -> set[tuple[str, str]]:
    return {(one.effect, one.change) for one in model.edits}


@pytest.mark.slow
def test_what_explains_clearly_more_takes_the_place_of_an_edit_that_was_made_first():
    case = draw_case(
        "pair",
        0,
        effects=["power_filter:remove", "pll_prefilter:remove"],
        severity="gross",
        noise_db=60,
        points=1,
        frequencies=12,
    )
    diagram = parse_program(case.program)
    wiring = wire(diagram, VOCABULARY)
    prior = build_prior(case.values, wiring, parameter_table(wiring, "exact"))
    bench = RepairState(
        SweepDataset(estimate_noise(case.sweep), VOCABULARY, prior, FEW, 0, "exact")
    )
    given = bench.dataset.fit_given(diagram)
    assert given is not None
    trials = rank_trials(bench, given, conventions=False)
    first = next(one for one in trials if one.edits[-1].effect == "reference_feedforward")
    removed = next(
        one
        for one in bench.dataset.insertions(first)
        if (one.effect, one.change) == ("pll_prefilter", "remove")
    )
    wrong = bench.dataset.fit_edit(first, removed)
    assert wrong is not None
    best, rivals = eliminate_backward(bench, given, wrong, trials)
    assert edits_of(best) == TRUE
    assert best.is_adequate(bench.scale)
    assert len(rivals) == 2
    assert any(step.startswith("exchanged: power_filter") for step in bench.steps)
    kept, _ = eliminate_backward(bench, given, best, trials)
    assert edits_of(kept) == TRUE


def drawn(*blocks: str) -> Diagram:
    diagram = Diagram("it")
    for name in blocks:
        diagram.add("Gain_dq", name)
    return diagram


def test_what_an_edit_takes_of_another_is_told_with_that_which_put_it_in():
    def edit(effect: str, change: Change, *blocks: str) -> Insertion:
        return Insertion(effect, change, f"at {effect}", drawn("own", *blocks), {}, {})

    both = edit("a", "add", "a1", "a2"), edit("b", "add", "a1", "a2", "b1")
    other, less = edit("c", "replace", "c1"), Insertion("less", "remove", "it", drawn(), {}, {})
    expected = [
        ((*both, edit("less", "remove", "a1", "b1")), ["at a, but for at less", "at b"]),
        ((*both, edit("less", "remove", "a1", "a2")), ["at a"]),
        (
            (other, edit("b", "add", "c1", "b1"), edit("less", "remove", "b1")),
            ["at c", "at b", "at less"],
        ),
        ((both[0], less), ["at a", "it"]),
    ]
    told = []
    for edits, _ in expected:
        given, best = (Model(drawn("own"), Convention(), UNFITTED, some) for some in ((), edits))
        told.append(
            [one.where for _, one in net_edits(Findings(None, given, best, (), (), (), 1.0, 0, ()))]
        )
    assert told == [words for _, words in expected]


def test_the_form_of_a_delay_that_went_later_is_not_told():
    def delayed(kind: str, *blocks: str) -> Diagram:
        diagram = drawn(*blocks)
        diagram.add(kind, "delay")
        return diagram

    def form(diagram: Diagram) -> Insertion:
        return Insertion("delay_form", "replace", "delay", diagram, {}, {}, form=True)

    hold, pade = form(delayed("ZOH_dq", "own")), form(delayed("Pade2_dq", "own"))
    lag = Insertion("lag", "add", "at lag", delayed("ZOH_dq", "own", "lag"), {}, {})
    gone = Insertion("gone", "remove", "at gone", drawn("own", "lag"), {}, {})
    exact = form(delayed("Delay", "own"))
    expected = [
        ((hold, lag, gone), ["at lag", "at gone"]),
        ((hold, lag), ["at lag", "delay"]),
        ((hold, exact), []),
    ]
    given = Model(delayed("Delay", "own"), Convention(), UNFITTED)
    for edits, words in expected:
        best = Model(given.diagram, Convention(), UNFITTED, edits)
        assert [
            one.where for _, one in net_edits(Findings(None, given, best, (), (), (), 1.0, 0, ()))
        ] == words
    assert find_lost_forms(given.diagram, (hold, pade)) == (0,)


@pytest.mark.parametrize(("error", "handed"), [(0.1, "nearest"), (0.3, "given")])
def test_where_nothing_explains_a_sweep_the_better_model_is_reported(error, handed):
    given, nearest = (
        SimpleNamespace(convention=Convention()),
        SimpleNamespace(convention=Convention()),
    )
    findings: Any = SimpleNamespace(given=given, best=nearest, is_repaired=True)
    baseline: Any = SimpleNamespace(nrmse=0.2)
    other: Any = SimpleNamespace(nrmse=error)
    model, record = _select_reported_model("unexplained", findings, baseline, lambda _: other)
    assert (model, record) == ((nearest, other) if handed == "nearest" else (given, baseline))
