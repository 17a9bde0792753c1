"""Twenty hidden cases of the gap benchmark, answered from their files alone, and what the targets
mean for so few.

The seed was fixed before anything was run; it is not to be changed for a result. `make bench-gap`
has the table of 200.
"""

import json
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest
from ibrid_bench.gap.diagnosis import Diagnosis
from ibrid_bench.gap.examination import examine
from ibrid_bench.gap.held_out import MOST
from ibrid_bench.gap.misses import miss, said
from ibrid_bench.gap.scoring import Row
from ibrid_bench.gap.trials import Trial, design, shares

from ibrid.gap.refitting.prior import read_values
from ibrid.gap.results.files import gap_json
from ibrid.gap.workflow import find_gap
from ibrid.measurement.read import read_sweep
from ibrid.structure.diagrams.program import read_program

CASES, SEED = 20, 2026
TRIALS = design(CASES, SEED)


def answered(folder: Path) -> Diagnosis:
    """The answer of `find_gap` to the files that an engineer has; the truth lies in another folder.

    Without suggestions, which come after the verdict.
    """
    began = time.perf_counter()
    values = read_values(folder / "nominal.json")
    gap = find_gap(
        read_program(folder / "model.py"), read_sweep(folder / "sweep.csv"), values, suggest=()
    )
    return Diagnosis(
        json.loads(json.dumps(gap_json(gap))), gap.repaired, time.perf_counter() - began
    )


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    out = tmp_path_factory.mktemp("blind")
    return [examine(trial, out, answer=answered) for trial in TRIALS]


def of_kind(rows: Iterable[Row], *kinds: str, above: bool = False) -> list[Row]:
    return [row for row in rows if row["kind"] in kinds and (row["above"] or not above)]


def told(rows: Iterable[Row]) -> str:
    """Each row in a line, for whoever sees a test fail."""
    return "".join(
        f"\n{row['key']}: hidden {row['hidden']}, said {said(row)}; {miss(row)}" for row in rows
    )


def with_name(rows: Iterable[Row]) -> list[Row]:
    """Cases with effects that have a name, all of them above the detection limit."""
    return [
        row for row in of_kind(rows, "effect", "pair", above=True) if row["named_first"] is not None
    ]


def test_the_twenty_cases_are_a_balanced_draw_and_none_is_left_out(rows: list[Row]):
    assert Counter(one.kind for one in TRIALS) == Counter(shares(CASES))
    assert [row["key"] for row in rows] == [one.key for one in TRIALS]
    assert all(Trial.parse(row["key"]) == one for row, one in zip(rows, TRIALS, strict=True))


def test_enough_hidden_effects_are_above_the_detection_limit_for_a_share_to_mean_something(
    rows: list[Row],
):
    assert len(with_name(rows)) >= CASES // 2, told(of_kind(rows, "effect", "pair"))


def test_no_answer_fails(rows: list[Row]):
    failed = [row for row in rows if row["failure"]]
    assert not failed, told(failed)


def test_where_nothing_is_missing_no_alarm_is_raised(rows: list[Row]):
    innocent = of_kind(rows, "nothing", "parameters", "wrong-noise")
    assert innocent
    alarms = [row for row in innocent if row["false_alarm"] or not row["right_verdict"]]
    assert not alarms, told(alarms)


def test_no_effect_is_given_a_wrong_name(rows: list[Row]):
    """Of what has a name: none outside the class; of what has none: no name at all. Below the limit
    as above.
    """
    wrong = [
        row
        for row in of_kind(rows, "effect", "pair")
        if row["verdict"] == "named" and not row["inside_class"]
    ]
    wrong += [row for row in of_kind(rows, "foreign") if row["false_name"]]
    assert not wrong, told(wrong)


def test_four_of_five_visible_effects_are_named_first(rows: list[Row]):
    """90 % is the target of the table of 200; of a dozen cases 80 % is what it promises with one
    miss more than expected.
    """
    seen = with_name(rows)
    missed = [row for row in seen if not row["named_first"]]
    assert len(missed) <= 0.2 * len(seen), told(missed)


def test_visible_effects_are_in_a_class_that_is_small(rows: list[Row]):
    seen = with_name(rows)
    outside = [row for row in seen if not row["inside_class"]]
    assert len(outside) <= 0.1 * len(seen), told(outside)
    sizes = [row["class_size"] for row in seen if row["class_size"]]
    assert sum(sizes) <= 2 * len(sizes)


def test_two_visible_effects_are_both_named(rows: list[Row]):
    pairs = of_kind(rows, "pair", above=True)
    missed = [row for row in pairs if not row["all_named"]]
    assert len(missed) <= 0.2 * len(pairs), told(missed)


def test_a_repaired_model_predicts_a_point_that_nobody_measured(rows: list[Row]):
    named = [
        row for row in of_kind(rows, "effect", "pair", above=True) if row["verdict"] == "named"
    ]
    poor = [row for row in named if row["holdout"] is None or row["holdout"] > MOST]
    assert len(poor) <= 0.1 * len(named), told(poor)


def test_what_the_catalogue_lacks_is_refused_in_words_that_say_where(rows: list[Row]):
    foreign = of_kind(rows, "foreign", above=True)
    wrong = [row for row in foreign if row["verdict"] not in ("located-unnamed", "unexplained")]
    assert foreign
    assert not wrong, told(wrong)


def test_a_wrong_convention_is_told_from_missing_physics(rows: list[Row]):
    written = of_kind(rows, "convention", above=True)
    wrong = [row for row in written if row["verdict"] != "data-convention"]
    assert written
    assert not wrong, told(wrong)


def test_below_the_detection_limit_nothing_is_made_up(rows: list[Row]):
    invented = [row for row in rows if row["above"] is False and miss(row)]
    assert not invented, told(invented)
