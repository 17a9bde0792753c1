"""The comparison of learning: measures of a course, statistics against closed forms, and that
nothing is made twice.
"""

import importlib.util
import json
import re
from collections import Counter
from dataclasses import dataclass, field, replace
from math import inf, log10, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_bench.learning.__main__ import main
from ibrid_bench.learning.arms import (
    ALL_ARMS,
    ARMS,
    HELD_OUT,
    INVERTERS,
    KNOWN,
    SEEDS,
    Case,
    cases,
    weights_digest,
)
from ibrid_bench.learning.comparison import (
    AREA,
    CONNECTIONS,
    TO_PAPER_ERROR,
    budgets,
    current,
    labels,
    longest_of_chance,
    of_arm,
    of_pair,
    pairs,
    share,
    verdict,
)
from ibrid_bench.learning.course import area, best_at, course_of, evaluations_to
from ibrid_bench.learning.drawn import drawn_inverter
from ibrid_bench.learning.measuring import endings, measured
from ibrid_bench.learning.page import measured_of, page
from ibrid_bench.learning.statistics import DRAWS, Estimate, differences, estimate, mean, median
from ibrid_bench.learning.tables import (
    answers_table,
    arms_table,
    inverters_table,
    pairs_table,
    sentences,
    table,
    updates_table,
)
from ibrid_bench.learning.updates import told
from ibrid_bench.ledger import NAME, Ledger
from ibrid_bench.search.inverters import inverter
from ibrid_policy.experience.drawn_diagram import drawn_diagram
from ibrid_policy.experience.examples import held_out_family
from ibrid_policy.experience.inverter import drawn_choices
from ibrid_policy.learning.settings import PROFILES, LearningSettings
from ibrid_policy.learning.updates import META, Update, updates_json
from ibrid_search.proposers.choose import Proposers
from ibrid_search.run.store import Store
from ibrid_search.step import Status, Step

import ibrid
from ibrid.errors import IbridError
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.reference import P1_Q03

SMALL = LearningSettings(contexts=4, group=8)
DOCS = Path(__file__).resolve().parents[2] / "docs"


# the course of a search


def test_only_steps_down_are_kept_of_a_trajectory():
    trajectory = [
        (1, 0.9, None),
        (2, 0.9, 0.9),
        (3, None, 0.9),
        (4, 0.5, 0.5),
        (5, 0.7, 0.5),
        (6, 0.4999999999, 0.4999999999),
    ]
    assert course_of(trajectory) == [[2, 0.9], [4, 0.5]]
    assert course_of([(1, None, None)]) == []


def test_the_best_error_is_that_of_no_model_before_the_first_and_stays_after_the_last():
    np.testing.assert_array_equal(
        best_at([[2, 0.9], [4, 0.5]], np.arange(1, 7)), [1, 0.9, 0.9, 0.5, 0.5, 0.5]
    )
    np.testing.assert_array_equal(best_at([], np.arange(3)), [1, 1, 1])


def test_the_area_of_one_step_is_its_height_times_its_length():
    assert area([[1, 0.1]], 128) == pytest.approx(-1)
    assert area([], 50) == 0
    for at in (1, 17, 100):
        assert area([[at, 1e-2]], 100) == pytest.approx(-2 * (101 - at) / 100)
    assert area([[1, 1e-15]], 10) == pytest.approx(-6)  # rounding is not worth more than 1e-6
    assert area([[11, 1e-2]], 10) == 0


def test_a_limit_counts_when_the_budget_reaches_it():
    course = [[1, 0.9], [40, 0.0435], [90, 1e-9]]
    assert evaluations_to(course, 0.0435, 128) == 40
    assert evaluations_to(course, 1e-3, 128) == 90
    assert evaluations_to(course, 1e-3, 89) == inf
    assert evaluations_to(course, 1e-10, 128) == inf


# statistics


def test_constant_values_have_an_interval_without_width():
    found = estimate({"a": [3.0] * 5, "b": [3.0] * 4}, median)
    assert found == Estimate(3.0, 3.0, 3.0, 9)
    assert found.excludes_zero
    assert not replace(found, low=0.0).excludes_zero
    assert not Estimate(3.0, None, None, 2).excludes_zero


def test_differences_between_inverters_do_not_widen_an_interval_and_those_between_seeds_do():
    apart = estimate({"easy": [0.0] * 10, "hard": [100.0] * 10}, mean)
    assert (apart.value, apart.low, apart.high) == (50.0, 50.0, 50.0)  # type: ignore[union-attr]
    mixed = estimate({"easy": [0.0, 100.0] * 5, "hard": [0.0, 100.0] * 5}, mean)
    assert mixed.low < 50 < mixed.high  # type: ignore[union-attr,operator]


def test_the_interval_of_a_mean_is_that_of_the_normal_law():
    rng = np.random.default_rng(0)
    groups = {
        name: rng.normal(level, 2.0, size=40)
        for name, level in (("a", 0.0), ("b", 7.0), ("c", -3.0))
    }
    found = estimate({name: list(values) for name, values in groups.items()}, mean)
    spread = (
        sqrt(sum(values.var() / 40 for values in groups.values())) / 3
    )  # of the mean of three means
    assert found is not None
    assert found.value == pytest.approx(np.mean([values.mean() for values in groups.values()]))
    # the 2.5 % quantile of 4000 draws has a standard deviation of 0.042 spreads, three times that
    # is allowed
    assert DRAWS == 4000
    assert found.low == pytest.approx(found.value - 1.96 * spread, abs=0.13 * spread)
    assert found.high == pytest.approx(found.value + 1.96 * spread, abs=0.13 * spread)


def test_the_median_of_three_is_any_of_the_three_in_one_draw_of_four():
    # 7/27 of the draws have the least as their median, which is more than 2.5 %
    assert estimate({"a": [1.0, 5.0, 9.0]}, median) == Estimate(5.0, 1.0, 9.0, 3)


def test_runs_that_never_arrive_count_as_beyond_every_budget():
    assert estimate({"a": [10.0, 20.0, inf]}, median) == Estimate(20.0, 10.0, inf, 3)
    assert estimate({"a": [10.0, inf, inf]}, median).value == inf  # type: ignore[union-attr]
    assert estimate({"a": [10.0, 20.0, inf, inf]}, median).value == inf  # type: ignore[union-attr]
    assert estimate({"a": [inf] * 6}, median) == Estimate(inf, inf, inf, 6)


def test_an_estimate_is_the_same_for_the_same_values_and_has_no_interval_from_two_seeds():
    values = {"a": [1.0, 2.0, 4.0], "b": [3.0, 0.0, 8.0]}
    assert estimate(values, median) == estimate(dict(reversed(values.items())), median)
    assert estimate({**values, "c": [1.0, 2.0]}, median) == Estimate(2.0, None, None, 8)
    assert estimate({}, median) is None
    assert estimate({"a": []}, median) is None


def test_differences_are_of_pairs_and_what_has_no_partner_is_left_out():
    first = {("a", 0): 5.0, ("a", 1): 7.0, ("b", 0): 1.0, ("b", 3): 9.0}
    second = {("a", 1): 3.0, ("a", 0): 4.0, ("b", 0): 1.0, ("c", 0): 2.0}
    assert differences(first, second) == {"a": [1.0, 4.0], "b": [0.0]}


# arms and inverters


def test_the_comparison_has_five_arms_at_least_five_inverters_and_ten_seeds():
    assert ARMS == ("random", "rules", "frozen", "learning", "mixed")
    assert len(INVERTERS) >= 5
    assert SEEDS == 10
    found = list(cases(SEEDS, 128, SMALL))
    assert len({one.key for one in found}) == len(found) == len(INVERTERS) * 5 * 10
    assert [one.arm for one in found[:5]] == list(ARMS)
    assert {one.seed for one in found[: 5 * len(INVERTERS)]} == {
        0
    }  # a part of it compares all arms


def test_a_result_that_would_be_another_has_another_key():
    one = Case("paper_like", "learning", 0, 128, SMALL, "aaaa")
    changes: list[dict[str, Any]] = [
        {"inverter": "gfm_dvoc"},
        {"arm": "untrained"},
        {"seed": 1},
        {"budget": 64},
        {"weights": "bbbb"},
        {"settings": replace(SMALL, group=4)},
        {"settings": replace(SMALL, contexts=2)},
        {"settings": replace(SMALL, rate=1e-3)},
        {"settings": replace(SMALL, baseline="parent")},
        {"settings": replace(SMALL, advantages="entropic")},
        {"settings": replace(SMALL, epochs=2)},
        {"settings": replace(SMALL, most_gain=2.0)},
    ]
    assert len({one.key, *(replace(one, **change).key for change in changes)}) == len(changes) + 1
    plain = replace(one, arm="rules")
    assert replace(plain, weights="bbbb").key == plain.key  # rules do not ask the policy
    assert replace(plain, settings=replace(SMALL, group=4)).key == plain.key
    assert replace(one, arm="frozen", weights="bbbb").key != replace(one, arm="frozen").key


def test_weights_have_a_digest_of_their_own(tmp_path):
    assert weights_digest(tmp_path) == "none"
    (tmp_path / "model.safetensors").write_bytes(b"one")
    first = weights_digest(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"two")
    assert len(first) == 12
    assert weights_digest(tmp_path) != first


def marks(diagram: ibrid.Diagram) -> set[str]:
    """Which held-out families a diagram looks like."""
    kinds = {one.name: one.kind for one in diagram.instances}
    found = {"oscillator"} if "dVOC" in kinds.values() else set()
    found |= (
        {"dc link with voltage control"}
        if {"DC_link", "Magnitude"} <= set(kinds.values())
        else set()
    )
    wires = [(one.source.split(".")[0], one.target) for one in diagram.connections]
    drivers = {name for name, target in wires if target == "plant.delta_omega"}
    return found | (
        {"hybrid"} if len(drivers) == 2 and "PI" in {kinds[name] for name in drivers} else set()
    )


def of_shipped(name: str) -> set[str]:
    truth = inverter(name).truth
    assert truth is not None
    return marks(truth)


def test_held_out_inverters_are_of_families_that_no_lesson_has_and_the_others_are_not():
    """Two ways: the choices from which lessons are drawn, and the kinds and wires of the shipped
    programs.
    """
    rng = np.random.default_rng(0)
    seen: Counter[str] = Counter()
    for _ in range(1500):
        choices = drawn_choices(rng)
        family = held_out_family(choices)
        found = marks(drawn_diagram(choices, VOCABULARY))
        assert family in (found or {""}), choices
        seen[family] += 1
    assert all(
        seen[one] > 3 for one in ("oscillator", "hybrid", "dc link with voltage control", "")
    )
    assert [of_shipped(name) for name in HELD_OUT] == [
        {"dc link with voltage control"},
        {"oscillator"},
        {"hybrid"},
    ]
    assert not any(of_shipped(name) for name in KNOWN)


# one search and its row


@dataclass(frozen=True)
class Found:
    """What stands for a run of the search."""

    answer_program: str
    trajectory: tuple = ((1, 0.9, 0.9), (2, 0.8, 0.8), (3, 0.04, 0.04), (4, 0.1, 0.04))
    selection: Any = field(default_factory=dict)
    best: Any = None
    evaluations: int = 4
    seconds: float = 3.0
    ending: str = "the budget is spent"
    finished: bool = True


STEPS = (
    Step(0, note="the start"),
    Step(1, 0, proposer="policy", status=Status.OK, usage={"samples": 3, "known": 2, "refused": 0}),
    Step(
        2,
        0,
        proposer="policy",
        status=Status.DUPLICATE,
        usage={"samples": 4, "known": 4, "refused": 0},
    ),
    Step(
        3,
        0,
        proposer="policy",
        status=Status.ILLEGAL,
        usage={"samples": 2, "known": 1, "refused": 1},
    ),
    Step(4, 0, proposer="pruning", status=Status.OK),
    Step(5, 0, proposer="rules", status=Status.UNCHANGED),
    Step(6, 0, proposer="rules", status=Status.FAILED),
)
UPDATE = Update(
    1,
    1,
    8,
    reward=0.123456,
    best_reward=0.5,
    valid=0.5,
    unchanged=0.0,
    duplicates=0.0,
    siblings=0.25,
    refused=0.5,
    failed=0.0,
    lost=0,
    dropped=1,
    tokens=30.0,
    entropy=1.5,
    divergence=0.0,
    weight=1.0,
    clipped=0.0,
    drift=1e-7,
    gradient=2.0,
    updated=True,
)


def scripted(
    seen: list | None = None,
    *,
    stop_after: int | None = None,
    curves: dict[str, tuple] | None = None,
):
    """A search that finds the truth of no inverter, keeps a store, and is stopped by the keyboard
    after some runs.
    """
    made: list = [] if seen is None else seen

    def search(sweep, folder, **options):
        if stop_after is not None and len(made) >= stop_after:
            raise KeyboardInterrupt
        made.append((sweep, options))
        folder.mkdir(parents=True)
        with Store.create(
            folder / "archive.sqlite",
            {META: updates_json([UPDATE]) if options["proposer"].learn else ""},
        ) as store:
            for step in STEPS:
                store.propose(step)
        label = options["proposer"].chosen + ("+" if options["proposer"].learn else "")
        steps = (curves or {}).get(label)
        program = inverter("gfl_l_filter").program
        return Found(program) if steps is None else Found(program, steps)

    return search


def test_a_row_holds_the_curve_the_answer_and_how_proposals_ended(tmp_path):
    seen: list = []
    case = Case("gfl_l_filter", "learning", 3, 99, SMALL, "abc")
    row = measured(case, tmp_path / "run", scripted(seen))
    ((sweep, options),) = seen
    assert len(sweep.points) == 2  # the search never sees the held-out point
    assert (options["proposer"], options["budget"], options["seed"]) == (
        Proposers("policy", learn=SMALL, informed=False),
        99,
        3,
    )
    assert options["start"] == ibrid.textbook("naive")
    assert (options["equilibrium"], options["parameters"]) == ("exact", "shared")
    assert row["curve"] == [[1, 0.9], [2, 0.8], [3, 0.04]]
    assert (row["modules_f1"], row["connections_f1"]) == (1.0, 1.0)
    assert (row["arm"], row["weights"], row["evaluations"]) == ("learning 4x8", "abc", 4)
    assert row["updates"] == told([UPDATE])
    assert json.loads(json.dumps(row)) == row
    frozen = measured(replace(case, arm="frozen"), tmp_path / "other", scripted(seen))
    assert seen[1][1]["proposer"].learn is False
    assert frozen["updates"] == []
    chance = measured(replace(case, arm="random"), tmp_path / "third", scripted(seen))
    assert (seen[2][1]["proposer"].chosen, chance["weights"]) == ("random", "")
    mixed = measured(replace(case, arm="mixed"), tmp_path / "fourth", scripted(seen))
    assert not seen[3][1]["proposer"].informed
    measured(replace(case, arm="informed"), tmp_path / "fifth", scripted(seen))
    assert seen[4][1]["proposer"].informed
    assert (seen[3][1]["proposer"].chosen, mixed["weights"]) == ("policy:0.5,rules:0.5", "abc")


def test_of_the_updates_means_over_eight_parts_of_a_run_are_kept():
    updates = [replace(UPDATE, reward=float(number), gain=None) for number in range(20)]
    found = told(updates)
    assert [one["reward"] for one in found] == [
        0.5,
        3,
        5.5,
        8,
        10.5,
        13,
        15.5,
        18,
    ]  # of 2, 3, 2, 3, ... updates
    assert [one["gain"] for one in found] == [None] * 8
    assert [one["reward"] for one in told(updates[:3])] == [0, 1, 2]
    assert told([UPDATE])[0]["reward"] == 0.1235
    assert told([]) == []


def test_an_answer_that_is_missing_has_no_module_right(tmp_path):
    def empty(sweep, folder, **options):
        return replace(scripted()(sweep, folder, **options), answer_program="", trajectory=())

    row = measured(Case("gfl_l_filter", "random", 0, 9, SMALL, ""), tmp_path / "run", empty)
    assert (row["curve"], row["modules_f1"], row["connections_f1"]) == ([], 0.0, 0.0)
    assert of_arm([row], AREA).value == 0  # type: ignore[union-attr]


def test_answers_that_the_policy_passed_over_are_counted():
    found = endings(STEPS)
    assert found["policy"]["answers"] == 9
    assert found["policy"]["known"] == 7
    assert (found["policy"]["valid"], found["policy"]["duplicate"], found["policy"]["refused"]) == (
        1,
        1,
        1,
    )
    assert (found["rules"]["answers"], found["rules"]["known"], found["rules"]["failed"]) == (
        2,
        1,
        1,
    )
    row = {"proposed": found}
    assert share([row], "valid") == pytest.approx(
        1 / 11
    )  # what is only taken away is nobody's idea
    assert sum(
        share([row], name) or 0 for name in ("valid", "known", "refused", "failed")
    ) == pytest.approx(1)
    assert share([], "valid") is None


# what the rows come to


def row(
    inverter: str, arm: str, seed: int, error: float, at: int = 1, **changes: Any
) -> dict[str, Any]:
    """A run that came to an error at once, or `at` some evaluation."""
    return {
        "key": f"{inverter}-{arm}-{seed}",
        "inverter": inverter,
        "arm": arm,
        "seed": seed,
        "budget": 100,
        "weights": "" if arm in ("random", "rules") else "new",
        "curve": [[at, error]],
        "evaluations": 100,
        "ending": "",
        "modules_f1": 0.5,
        "connections_f1": 0.25,
        "proposed": endings(STEPS),
        "seconds": 2.0,
        "updates": told([UPDATE]) if arm.startswith(("learning", "untrained")) else [],
        **changes,
    }


def many(gain: float = 0.0, *, noise: float = 1.0) -> list[dict[str, Any]]:
    """Ten seeds of three arms on two inverters; learning is `gain` decades better than the frozen
    policy, in every pair.
    """
    rng = np.random.default_rng(1)
    rows = []
    for name in ("paper_like", "gfm_dvoc"):
        for seed in range(10):
            error = 10 ** (-1 - noise * rng.random())
            rows.append(row(name, "frozen", seed, error))
            rows.append(row(name, "learning 4x8 look", seed, error * 10**-gain))
            rows.append(row(name, "random", seed, 0.5))
    return rows


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("drawn_dc_link", {"DC_link", "Magnitude"}),
        ("drawn_oscillator", {"dVOC"}),
        ("drawn_hybrid", {"Integrator", "PI"}),
    ],
)
def test_a_drawn_inverter_is_of_its_family_and_another_for_every_seed(name, kinds):
    first, again, other = (drawn_inverter(name, number) for number in (0, 0, 1))
    assert first.program == again.program
    assert first.values == again.values != other.values
    assert first.values is not None
    assert first.truth is not None
    assert all(f'"{kind}"' in first.program for kind in kinds)
    for point, twin in zip(first.sweep.points, again.sweep.points, strict=True):
        np.testing.assert_array_equal(point.admittance, twin.admittance)
    assert [point.op.name for point in first.sweep.points] == [op.name for op in P1_Q03]
    warm = {point.op.name: first.values for point in first.sweep.points}
    found = ibrid.evaluate(first.truth, first.sweep, warm=warm, restarts=0)
    assert found.nrmse is not None
    assert found.nrmse < 1e-6  # its truth is its measurement


def test_drawn_inverters_are_a_group_of_their_own():
    rows = [
        row | {"inverter": "drawn_hybrid"} for row in many(0.25) if row["inverter"] == "gfm_dvoc"
    ]
    text = page([*many(), *rows])
    assert "| learning 4x8 look - frozen | drawn | " in squeezed(pairs_table([*many(), *rows]))
    assert "| `drawn_hybrid`   | drawn" in text
    assert arms_table([*many(), *rows]) == arms_table(many())
    assert "drawn" not in page(many()).partition("### Every arm")[2]


def test_a_gain_in_every_pair_is_found_exactly_however_much_runs_differ():
    found = of_pair(many(0.25), "learning 4x8 look", "frozen", AREA)
    assert found is not None
    assert (found.value, found.low, found.high) == pytest.approx((-0.25, -0.25, -0.25))
    assert found.number == 20
    assert verdict(AREA, found) == "a gain"
    assert verdict(AREA, of_pair(many(-0.25), "learning 4x8 look", "frozen", AREA)) == "a loss"
    assert verdict(CONNECTIONS, Estimate(0.1, 0.05, 0.2, 9)) == "a gain"
    assert (
        verdict(AREA, of_pair(many(0.0), "learning 4x8 look", "frozen", AREA))
        == "neither a gain nor a loss is shown"
    )
    assert verdict(AREA, of_pair(many(), "learning 4x8 look", "mixed", AREA)) == "not measured yet"
    assert (
        verdict(AREA, of_pair(many()[:6], "learning 4x8 look", "frozen", AREA))
        == "too few seeds for an interval"
    )


def test_a_gain_by_chance_is_none():
    rng = np.random.default_rng(5)
    rows = [
        row("paper_like", arm, seed, 10 ** -rng.random())
        for seed in range(10)
        for arm in ("frozen", "learning 4x8 look")
    ]
    assert (
        verdict(AREA, of_pair(rows, "learning 4x8 look", "frozen", AREA))
        == "neither a gain nor a loss is shown"
    )


def test_in_a_difference_a_limit_that_was_not_reached_counts_as_the_budget():
    rows = [row("paper_like", "frozen", seed, 0.01 if seed else 0.9, at=40) for seed in range(3)]
    rows += [row("paper_like", "random", seed, 0.9) for seed in range(3)]
    found = of_pair(rows, "frozen", "random", TO_PAPER_ERROR)
    assert found is not None
    assert found.value == pytest.approx((0 - 60 - 60) / 3)
    assert of_arm([one for one in rows if one["arm"] == "frozen"], TO_PAPER_ERROR).value == 40  # type: ignore[union-attr]


def test_rows_of_other_weights_are_left_out_and_arms_keep_their_order():
    rows = [
        row("paper_like", "frozen", 0, 0.1, weights="old"),
        row("paper_like", "rules", 0, 0.1),
        row("paper_like", "mixed", 0, 1),
    ]
    assert [one["arm"] for one in current(rows)] == ["rules", "mixed"]
    assert len(current(rows[:2])) == 2
    assert current([]) == []
    more = ("untrained 4x8 look", "learning 2x4 rate 0.001", "blind")
    found = labels([*many(), *(row("gfm_dvoc", label, 0, 0.1) for label in more)])
    assert found == [
        "random",
        "frozen",
        "learning 4x8 look",
        "learning 2x4 rate 0.001",
        "untrained 4x8 look",
        "blind",
    ]
    # learning from looks is told from the policy that looks, learning from fits from the one that
    # does not
    assert ("learning 4x8 look", "untrained 4x8 look") in pairs(found)
    assert ("learning 4x8 look", "frozen") in pairs(found)
    assert ("learning 2x4 rate 0.001", "blind") in pairs(found)
    assert ("learning 2x4 rate 0.001", "frozen") not in pairs(found)
    assert ("learning small", "untrained 1x8 look") in pairs(
        ["learning small", "untrained 8x1", "untrained 1x8 look"]
    )
    assert ("learning 8x1 parent", "untrained 8x1") in pairs(
        ["learning 8x1 parent", "untrained 8x1"]
    )
    assert {("frozen", "blind"), ("frozen", "random")} <= set(pairs(found))
    assert ("mixed blind", "rules") in pairs(["rules", "mixed blind"])
    assert ("mixed", "rules") not in pairs(found)
    assert pairs(["rules", "frozen", "mixed"]) == [("mixed", "rules"), ("mixed", "frozen")]


def squeezed(table: str) -> str:
    """Without what pads the columns."""
    return re.sub(" +", " ", table)


def test_the_tables_say_what_the_rows_say():
    rows = many(0.5)
    arms = squeezed(arms_table(rows))
    assert len(arms.splitlines()) == 5
    assert "| random | 20 | > 100 " in arms
    assert "[> 100, > 100]" not in arms  # an interval without a width says nothing
    assert "| learning 4x8 look | 20 | 9 % | 73 % " in squeezed(answers_table(rows))
    assert f"{log10(0.5):.2f}" in arms
    shown = squeezed(pairs_table(rows))
    for place in ("all", "trained on", "held out"):
        assert f"| learning 4x8 look - frozen | {place} " in shown
    assert "-0.50 [-0.50, -0.50] *" in shown
    assert "| `gfm_dvoc`       | held out | 0.5, 0 of 10 |" in inverters_table(rows)
    assert "| `gfm_droop`      |          | -" in inverters_table(rows)
    assert "| learning 4x8 look | 1 | 20 | 0.123" in squeezed(updates_table(rows))
    told = sentences(rows)
    assert any(
        "held-out families (pairs: 10): mean difference of the area -0.50 [-0.50, -0.50], a gain."
        in one
        for one in told
    )
    both = [*rows, *(one | {"arm": "mixed"} for one in rows if one["arm"] == "frozen")]
    assert any(
        "`mixed` against `frozen`, all inverters (pairs: 20): mean difference of the area +0.00"
        in one
        for one in sentences(both)
    )
    assert sentences([]) == []
    assert "Nothing of it" in table(["a"], [])


def test_chance_may_be_given_more_evaluations_than_the_rest_and_has_no_section_of_its_own():
    longer = [row("paper_like", "random", seed, 0.01, at=390, budget=400) for seed in range(3)]
    assert longest_of_chance([*many(), *longer]) == longer
    assert budgets([*many(), *longer]) == [100]
    text = page([*many(), *longer])
    assert "random edits 390; asked: a third" in text
    assert "random edits > 100; asked: a third" in page(many())
    assert text.count("\n## ") == 1


def test_the_page_tells_of_drawn_inverters_alone():
    rows = [
        row("drawn_hybrid", arm, seed, 0.1)
        for arm in ("frozen", "learning small")
        for seed in range(3)
    ]
    text = page(rows)
    assert (
        "drawn inverters of held-out families (pairs: 3): mean difference of the area +0.00" in text
    )
    assert "| learning small | 3 " in text


def test_other_ways_of_learning_stand_apart():
    compared = [one | {"arm": one["arm"].replace("4x8 look", "small")} for one in many()]
    tried = [one for one in many(0.5) if one["arm"] == "learning 4x8 look"]
    assert "### Other ways of learning" not in page(compared)
    main, _, other = squeezed(page([*compared, *tried])).partition("### Other ways of learning")
    assert "learning 4x8 look" not in main
    assert "learning small" in main
    assert "| learning 4x8 look | 20 |" in other
    assert "learning small" not in other


def test_the_page_says_how_much_is_measured():
    whole = len(INVERTERS) * 5 * SEEDS
    assert f"None of the {whole} runs" in page([])
    assert f"40 of the {whole} runs" in measured_of(many())  # the whole learns as the profile says
    small = [row | {"arm": row["arm"].replace("4x8 look", "small")} for row in many()]
    assert f"60 of the {whole} runs" in measured_of(small)
    text = page(small)
    assert f"60 of the {whole} runs" in text
    assert text.count("\n## ") == 1
    assert page([*many(), row("paper_like", "rules", 0, 0.1, budget=500)]).count("\n## ") == 2
    assert max(map(len, page([]).splitlines())) < 130
    odd = row(
        "paper_like", "rules", 77, 0.1
    )  # beyond the ten seeds, and the control, are no part of the whole
    assert f"60 of the {whole} runs" in measured_of(
        [*small, odd, row("gfm_dvoc", "untrained 1x8 look", 0, 0.1)]
    )


# the command


def options(tmp_path: Path, *more: str) -> list[str]:
    return [
        "--seeds",
        "1",
        "--budget",
        "20",
        "--inverter",
        "gfl_l_filter",
        "--out",
        str(tmp_path / "out"),
        *more,
    ]


def at_once() -> None:
    """The policy can be asked."""


def test_every_run_is_printed_and_kept_and_nothing_is_made_twice(tmp_path, capsys):
    seen: list = []
    assert main(options(tmp_path), search=scripted(seen), ready=at_once) == 0
    shown = capsys.readouterr().out
    assert len(seen) == 5
    assert shown.count("\ngfl_l_filter ") == 5
    assert "learning small - frozen" in shown
    text = (tmp_path / "out" / "learning_results.md").read_text(encoding="utf-8")
    assert "## 20 evaluations" in text
    assert "5 of the 300 runs" in text
    assert (
        main(
            options(tmp_path),
            search=scripted(seen),
            ready=lambda: pytest.fail("nothing is to be made"),
        )
        == 0
    )
    assert len(seen) == 5
    assert capsys.readouterr().out == shown
    assert (
        main(
            options(tmp_path, "--group", "4", "--arm", "learning"),
            search=scripted(seen),
            ready=at_once,
        )
        == 0
    )
    assert len(seen) == 6
    assert seen[-1][1]["proposer"].learn == replace(PROFILES["small"], group=4)
    assert "learning 1x4 look entropic sgd - frozen" in capsys.readouterr().out
    other = ("--arm", "learning", "--profile", "paper", "--contexts", "1", "--epochs", "2")
    assert main(options(tmp_path, *other), search=scripted(seen), ready=at_once) == 0
    assert len(seen) == 7
    assert seen[-1][1]["proposer"].learn == LearningSettings(contexts=1, epochs=2)
    assert "learning 1x16 epochs 2" in capsys.readouterr().out
    assert main(options(tmp_path, "--arm", "untrained"), search=scripted(seen), ready=at_once) == 0
    assert 0 < seen[-1][1]["proposer"].learn.rate < 1e-20
    assert "untrained 1x8 look" in capsys.readouterr().out


def test_an_interrupted_comparison_goes_on_and_ends_as_if_it_had_not_been(tmp_path, capsys):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert main(options(whole), search=scripted(), ready=at_once) == 0
    assert main(options(parts), search=scripted(stop_after=2), ready=at_once) == 1
    assert f"--out {parts / 'out'}" in capsys.readouterr().err
    with (parts / "out" / NAME).open("a", encoding="utf-8") as stream:
        stream.write('{"key": "gfl_l_filter-froz')  # killed while it wrote
    seen: list = []
    assert main(options(parts), search=scripted(seen), ready=at_once) == 0
    assert len(seen) == 3
    for name in (NAME, "learning_results.md"):
        assert (parts / "out" / name).read_text(encoding="utf-8") == (
            whole / "out" / name
        ).read_text(encoding="utf-8")


def test_a_search_that_ended_softly_at_the_keyboard_is_no_result(tmp_path, capsys):
    def stopped(sweep, folder, **given):
        return replace(scripted()(sweep, folder, **given), finished=False, evaluations=2)

    assert main(options(tmp_path), search=stopped, ready=at_once) == 1
    assert "goes on from here" in capsys.readouterr().err
    assert not Ledger(tmp_path / "out").rows


def test_ledgers_of_two_parts_may_be_joined_line_by_line(tmp_path):
    text = ""
    for arm in ("rules", "frozen"):
        assert main(options(tmp_path / arm, "--arm", arm), search=scripted(), ready=at_once) == 0
        text += (tmp_path / arm / "out" / NAME).read_text(encoding="utf-8")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / NAME).write_text(text, encoding="utf-8")
    assert (
        main(options(tmp_path, "--arm", "rules", "--arm", "frozen"), search=scripted(stop_after=0))
        == 0
    )


def test_a_run_that_fails_says_so_and_is_tried_again(tmp_path, capsys):
    good = scripted()

    def moody(sweep, folder, **given):
        if given["proposer"].chosen == "random":
            raise IbridError("the start must have a fit")
        return good(sweep, folder, **given)

    assert main(options(tmp_path), search=moody, ready=at_once) == 1
    assert "gfl_l_filter-random-20-0: the start must have a fit" in capsys.readouterr().out
    assert len(Ledger(tmp_path / "out").rows) == 4
    assert main(options(tmp_path), search=good, ready=at_once) == 0
    assert len(Ledger(tmp_path / "out").rows) == 5


def test_where_the_policy_cannot_be_asked_nothing_begins_but_arms_without_it_do(tmp_path, capsys):
    def missing() -> None:
        raise IbridError("the policy needs the package torch")

    assert main(options(tmp_path), search=scripted(), ready=missing) == 2
    assert capsys.readouterr().err == "bench-learning: the policy needs the package torch\n"
    assert not (tmp_path / "out").exists()
    assert (
        main(
            options(tmp_path, "--arm", "rules", "--arm", "random"), search=scripted(), ready=missing
        )
        == 0
    )


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (["--inverter", "gfm_drop"], "there is no inverter of this comparison called gfm_drop"),
        (["--arm", "frozn"], "there is no arm called frozn"),
        (["--page", "nowhere/page.md"], "there is no folder"),
        (["--profile", "paper", "--group", "1"], "a group needs 2 answers or more"),
        (
            ["--profile", "tiny"],
            "there is no profile of learning called 'tiny'; known are paper and small",
        ),
    ],
)
def test_wrong_options_are_one_sentence(tmp_path, capsys, wrong, sentence):
    assert main([*options(tmp_path), *wrong], search=scripted(), ready=at_once) == 2
    shown = capsys.readouterr()
    assert sentence in shown.err
    assert shown.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_results_of_another_benchmark_are_left_alone(tmp_path, capsys):
    Ledger(tmp_path / "out").add({"key": "structure-paper_like", "nrmse": 0.1})
    assert main(options(tmp_path), search=scripted(), ready=at_once) == 2
    assert "holds results of another benchmark; try another --out" in capsys.readouterr().err
    assert len(Ledger(tmp_path / "out").rows) == 1


# what ships, and the control


def test_the_page_in_the_docs_is_that_of_its_ledger():
    ledger = DOCS / "measured" / "learning" / NAME
    rows = Ledger(ledger.parent).rows.values() if ledger.exists() else []
    assert (DOCS / "learning_results.md").read_text(encoding="utf-8") == page(rows)


@pytest.mark.skipif(
    any(importlib.util.find_spec(one) is None for one in ("torch", "transformers")),
    reason="needs torch and transformers; make setup-llm",
)
@pytest.mark.filterwarnings("default")  # torch and transformers have warnings of their own
def test_the_control_of_learning_updates_and_changes_no_weight():
    from ibrid_policy.interface import Sampled
    from ibrid_policy.learning.trainer import Group, RewardTrainer, fingerprint
    from toy_policy import ASK, END, FIRST, tiny_model

    def weights_after(rate: float) -> str:
        model = tiny_model(FIRST + 2)
        answers = tuple(Sampled((FIRST + token, END), (-1.0, -1.0)) for token in (0, 1))
        group = Group((ASK, ASK), answers, (None, None), np.array([1.0, -1.0]))
        trained = RewardTrainer(model, LearningSettings(rate=rate, stop=inf)).update([group])
        assert trained.updated
        assert trained.gradient > 0
        return fingerprint(model)

    rate = ALL_ARMS["untrained"].rate
    assert rate is not None
    assert weights_after(rate) == fingerprint(tiny_model(FIRST + 2)) != weights_after(0.01)
