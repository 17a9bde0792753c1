"""What an engineer doubts in a fitted candidate: layers that are missing, parameters at their
bounds, absurd plants.
"""

from dataclasses import replace

import pytest
from fitted import TRUE, benchmark
from ibrid_search.archives.appraisal import Appraisal
from ibrid_search.run.store import Store
from ibrid_search.screening.plausibility import NO_ISSUES, PlausibilityIssues, count_issues
from ibrid_search.screening.selection_criterion import NoiseFloor, SelectionCriterion
from ibrid_search.screening.settings import SCREENING
from ibrid_search.settings import SearchSettings
from ibrid_search.step import Status, Step

import ibrid
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.program import program_text

CRITERION = SelectionCriterion(NoiseFloor(SCREENING.exact_error, 0.0, "unknown noise"), 1e-3)


def record_with(program: str, **changes: float):
    values = {**TRUE, **{name.replace("__", "."): value for name, value in changes.items()}}
    diagram = ibrid.textbook(program)
    record = ibrid.evaluate(ibrid.textbook("naive"), benchmark(), restarts=0)
    return diagram, replace(
        record, at_bound=(), parameters=dict.fromkeys(benchmark().names, values)
    )


def test_the_true_inverter_is_sound():
    assert count_issues(*record_with("gfl_pll_filter_exact"), VOCABULARY) == NO_ISSUES


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", [{"plant__L_F": 1.1e-4}, {"plant__R_F": 1.0}, {"plant__C_F": 1e-4}]
)
def test_a_plant_that_stands_in_for_a_controller_is_absurd(change):
    assert count_issues(
        *record_with("gfl_pll_filter_exact", **change), VOCABULARY
    ) == PlausibilityIssues(absurd=1)


def test_a_value_that_noise_leaves_open_is_not_absurd():
    diagram, record = record_with("gfl_pll_filter_exact", plant__R_F=1.0)

    def told(
        interval: tuple[float, float] | None, over_noise: float | None = 1.0
    ) -> PlausibilityIssues:
        intervals = {op: {"plant.R_F": interval} for op in record.parameters}
        return count_issues(
            diagram, replace(record, intervals=intervals, over_noise=over_noise), VOCABULARY
        )

    assert told(None) == told((0.3, 3.0)) == NO_ISSUES  # twice its logarithm reaches down to 0.09
    assert told((0.9, 1.1)) == told(None, over_noise=None) == PlausibilityIssues(absurd=1)


def test_a_small_resistance_is_not_absurd():
    assert (
        count_issues(*record_with("gfl_pll_filter_exact", plant__R_F=1e-5), VOCABULARY) == NO_ISSUES
    )


def read_nominal_value(tmp_path, **changes):
    """The entry of a fitted step with such a record."""
    diagram, record = record_with("gfl_pll_filter_exact")
    record = replace(record, nrmse=5e-4, over_noise=None, free_parameters=13, **changes)
    with Store.create(tmp_path / "archive.sqlite", {}) as store:
        store.propose(Step(0, program=program_text(diagram), hash="h"))
        store.conclude(0, status=Status.OK, record=record)
        return Appraisal(store, CRITERION, VOCABULARY).entry(store.step(0))


@pytest.mark.slow
def test_a_parameter_at_its_bound_costs_rank(tmp_path):
    (tmp_path / "free").mkdir()
    sound, bound = (
        read_nominal_value(tmp_path),
        read_nominal_value(tmp_path / "free", at_bound=("plant.L_F", "decoupling.L")),
    )
    assert bound.reward == pytest.approx(sound.reward - 2 * CRITERION.settings.bound)
    assert (sound.sort, sound.plain) == ("phase", CRITERION.parent_reward(5e-4, 0))


def test_a_diagram_with_an_absurd_plant_is_of_another_sort(tmp_path):
    absurd = {name: {**TRUE, "plant.R_F": 1.0} for name in benchmark().names}
    found = read_nominal_value(tmp_path, parameters=absurd)
    assert found.sort == "phase, absurd plant"
    assert found.plain == CRITERION.parent_reward(SCREENING.doubtful_error, 0)


def test_the_naive_diagram_lacks_every_layer():
    diagram, record = record_with("naive")
    assert count_issues(diagram, record, VOCABULARY).missing == 3


def test_parameters_at_their_bounds_are_counted():
    diagram, record = record_with("gfl_exact")
    assert (
        count_issues(
            diagram, replace(record, at_bound=("pll.kP_pll", "current.kI")), VOCABULARY
        ).at_bound
        == 2
    )


def test_residual_modules_are_counted_and_no_reason_to_doubt_the_rest():
    diagram, record = record_with("gfl_exact")
    found = count_issues(diagram, replace(record, residual_modules=2), VOCABULARY)
    assert (found.residual, found.total) == (2, 0)
    assert CRITERION.score(0.01, 13, found) == CRITERION.score(0.01, 13)


def test_a_residual_module_has_a_price_among_parents():
    priced = replace(CRITERION, settings=SearchSettings(residual=0.5))
    # worth it only where it lowers the error by more than its price: e^-0.5 = 0.607
    assert priced.parent_reward(0.0062, 13, PlausibilityIssues(residual=1)) < priced.parent_reward(
        0.01, 13
    )
    assert priced.parent_reward(0.0060, 13, PlausibilityIssues(residual=1)) > priced.parent_reward(
        0.01, 13
    )


def test_an_absurd_plant_earns_nothing_below_the_doubtful_error():
    absurd = PlausibilityIssues(absurd=1)
    assert CRITERION.parent_reward(1e-9, 13, absurd) == CRITERION.parent_reward(
        SCREENING.doubtful_error, 13
    )
    assert CRITERION.score(4e-7, 13, absurd) > CRITERION.score(
        7e-4, 12
    )  # a sound structure is the answer
    assert CRITERION.score(0.1, 13, absurd) < CRITERION.score(
        0.2, 13
    )  # where nothing fits, the error decides


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "better"), [(1e-9, "fewer states"), (1e-3, "less error")])
def test_of_two_that_fit_the_same_the_one_with_fewer_states_is_better(tmp_path, gain, better):
    diagram, record = record_with("gfl_pll_filter_exact")
    record = replace(record, over_noise=None, free_parameters=13)
    candidates = {"fewer states": (5e-4, 13), "less error": (5e-4 * (1 - gain), 14)}
    with Store.create(tmp_path / "archive.sqlite", {}) as store:
        for number, (nrmse, order) in enumerate(candidates.values()):
            store.propose(Step(number, program=program_text(diagram), hash=f"h{number}"))
            store.conclude(
                number, status=Status.OK, record=replace(record, nrmse=nrmse, order=order)
            )
        appraisal = Appraisal(store, CRITERION, VOCABULARY)
        best = min(range(2), key=lambda number: appraisal.rank(store.step(number)))
    assert list(candidates)[best] == better


def test_a_twin_of_a_published_control_with_a_number_less_is_not_better_than_it(tmp_path):
    diagram, record = record_with("gfl_pll_filter_exact")
    sizes = {"published": 13, "twin": 12, "much smaller": 11}
    with Store.create(tmp_path / "archive.sqlite", {}) as store:
        for number, (name, free) in enumerate(sizes.items()):
            store.propose(Step(number, program=program_text(diagram), hash=name))
            exact = replace(record, nrmse=1e-9, misfit=None, free_parameters=free)
            store.conclude(number, status=Status.OK, record=exact)
        alike, known = (
            Appraisal(store, CRITERION, VOCABULARY, published) for published in ((), ("published",))
        )
        steps = [store.step(number) for number in range(len(sizes))]
        assert [step.hash for step in sorted(steps, key=alike.rank)] == [
            "much smaller",
            "twin",
            "published",
        ]
        assert [step.hash for step in sorted(steps, key=known.rank)] == [
            "much smaller",
            "published",
            "twin",
        ]
