"""The benchmark of the gap workflow: its cases are balanced, its subject is blind, its scores are
those of known answers.
"""

import ast
import json
import sys
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_bench.gap.__main__ import main, wanted
from ibrid_bench.gap.detection import LIMIT, REMOVAL_LIMIT, Visibility, visibilities
from ibrid_bench.gap.diagnosis import COMMAND, Diagnosis, diagnose
from ibrid_bench.gap.examination import examine
from ibrid_bench.gap.held_out import held_out_ratio, noise_floor, predicted
from ibrid_bench.gap.misses import confusions, miss
from ibrid_bench.gap.scoring import Row, score
from ibrid_bench.gap.several import GROUPS, group_of, several
from ibrid_bench.gap.share import Share, Z
from ibrid_bench.gap.tables import WIDTH, report, trial_line
from ibrid_bench.gap.trials import MAIN, NUMBERS, UNSTATED, Trial, design, shares, unstated
from ibrid_bench.hidden.case import Case
from ibrid_bench.hidden.declaration import SEVERITIES
from ibrid_bench.hidden.effects import HIDDEN
from ibrid_bench.hidden.elsewhere import CONVENTIONS, FOREIGN
from ibrid_bench.search.hidden import exact_model
from sharing import shared

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.conventions.rotation import rotation

PACKAGE = Path(__file__).resolve().parents[2] / "ibrid"
DELAY = "effect/control_delay:add:command/clear/60dB/16x2/7"
NOTHING = "nothing/any/clear/60dB/16x2/8"
SEEN = (Visibility(1e6, 0.0, "add"),)
UNSEEN = (Visibility(LIMIT - 1, 0.0, "add"),)


@shared
def case_of(key: str) -> Case:
    return Trial.parse(key).case()


def record_of(case: Case, *, repaired: bool = True) -> Record:
    """The device itself, or the given model, at its true values."""
    truth = case.truth
    device = truth["device"] if repaired else {"program": case.program, "values": truth["values"]}
    points = [one.op for one in case.sweep.points]
    return exact_model(device["program"], device["values"], points, 60.0, case.sweep.power_node)


def effect(name: str, *others: str, **parameters: Any) -> dict[str, Any]:
    key, change = name.split(":")
    return {
        "id": key,
        "change": change,
        "parameters": parameters,
        "indistinguishable_from": list(others),
    }


def answered(case: Case, verdict: str, *effects: dict[str, Any], repaired: bool = False) -> Row:
    """The row of an answer whose model is the device, or still the given one."""
    record = record_of(case, repaired=repaired)
    gap = {"verdict": verdict, "effects": list(effects), "program": record.program}
    several = len(case.truth["effects"])
    row = score(case, Diagnosis(gap, record, 2.0), SEEN * several)
    cell = {"data": "60dB", "frequencies": 16, "points": 2, "effects": []}
    return {"key": "a/trial", "kind": case.truth["kind"], **cell, **row}


# the table


def test_the_table_has_its_numbers_of_each_kind_and_another_size_has_them_in_proportion():
    assert Counter(one.kind for one in design(200, 1)) == Counter(NUMBERS)
    assert shares(200) == dict(NUMBERS)
    for cases in (1, 20, 33, 400):
        assert sum(shares(cases).values()) == cases
        assert all(
            abs(shares(cases)[kind] - cases * number / 200) < 1 for kind, number in NUMBERS.items()
        )


def test_every_effect_is_hidden_about_equally_often_and_never_twice_alike():
    trials = [one for one in design(200, 1) if one.kind == "effect"]
    often = Counter(one.effects for one in trials)
    assert set(often) == {(one.key,) for one in HIDDEN}
    assert max(often.values()) - min(often.values()) <= 1
    assert max(Counter((one.effects, one.severity) for one in trials).values()) == 1
    strengths = Counter(one.severity for one in trials)
    assert max(strengths.values()) - min(strengths.values()) <= len(SEVERITIES)
    assert {one.effects for one in design(200, 1) if one.kind == "foreign"} == {
        (one.key,) for one in FOREIGN
    }
    assert {one.effects for one in design(200, 1) if one.kind == "convention"} == {
        (one.key,) for one in CONVENTIONS
    }


def test_most_cases_are_those_that_targets_are_stated_for_and_every_level_occurs():
    trials = design(200, 1)
    main = [one for one in trials if (one.noise_db, one.frequencies, one.points) in MAIN]
    assert 0.7 < len(main) / len(trials) < 0.8
    assert {one.noise_db for one in trials} == {None, 60.0, 40.0, 20.0}
    assert {(one.frequencies, one.points) for one in trials} == {
        (k, m) for k in (16, 60) for m in (1, 2, 4)
    }


def test_a_table_follows_from_its_seed_and_a_trial_from_its_key():
    assert design(200, 1) == design(200, 1)
    assert not {one.seed for one in design(200, 1)} & {one.seed for one in design(200, 2)}
    trials = design(200, 3)
    assert len({one.folder for one in trials}) == 200
    assert [Trial.parse(one.key) for one in trials] == list(trials)


def test_beside_the_table_stand_noisy_sweeps_that_do_not_state_their_noise():
    trials = unstated(200, 3)
    assert Counter(one.kind for one in trials) == {"nothing": 10, "effect": 10}
    assert {one.noise_db for one in trials} == {60.0, 40.0}
    assert not {one.seed for one in trials} & {one.seed for one in design(200, 3)}
    assert [Trial.parse(one.key) for one in trials] == list(trials)
    (seen, other), (known, _) = trials[0].case().sweep.points, trials[0].stated_case().sweep.points
    assert seen.sigma is None
    assert other.sigma is None
    assert known.sigma is not None
    assert np.array_equal(seen.admittance, known.admittance)


def test_beside_the_table_three_effects_are_hidden_and_models_have_blocks_that_must_go():
    trials = several(200, 3)
    assert Counter(group_of(one.effects) for one in trials) == dict.fromkeys(GROUPS, 30)
    assert trials == several(200, 3)
    assert not {one.seed for one in trials} & {
        one.seed for one in (*design(200, 3), *unstated(200, 3))
    }
    for trial in trials[::15]:
        assert Trial.parse(trial.key) == trial
        assert [one["change"] for one in trial.case().truth["effects"]] == [
            key.split(":")[1] for key in trial.effects
        ]


def test_sweeps_that_do_not_state_their_noise_have_rows_of_their_own():
    stated, other = (
        answered(case_of(NOTHING), "no-gap"),
        answered(case_of(NOTHING), "named", effect("power_filter:add")),
    )
    text = "\n".join(
        report([{**stated, "noise_db": 60.0}, {**other, "noise_db": 60.0, "stated": False}])
    )
    lines = [line for line in text.splitlines() if line.startswith("nothing hidden: false alarm")]
    assert [line.split()[4] for line in lines] == ["0/1", "1/1"]


@pytest.mark.parametrize(
    "key", ["effect", "effect/x/clear/60dB/16x2", "effects/x/clear/60dB/16x2/1", "pair/any/a/b/c/d"]
)
def test_what_is_no_trial_is_refused_with_an_example(key):
    with pytest.raises(IbridError, match="such as effect/control_delay"):
        Trial.parse(key)


def test_every_trial_of_a_table_can_be_drawn():
    for trial in design(200, 4):
        assert len(trial.case().sweep.points) == trial.points


# blindness


def test_nothing_but_the_benchmark_knows_the_generator():
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("ibrid_bench") for name in names), path


_SPY = """
import json, os, sys
from pathlib import Path
Path("spied.json").write_text(json.dumps({"cwd": os.getcwd(), "argv": sys.argv, "files": sorted(os.listdir("."))}))
sys.exit("spy: seen enough")
"""


def test_the_diagnosing_process_gets_model_nominal_values_and_sweeps_and_no_truth(tmp_path):
    spied: list[dict] = []

    def spy(folder: Path) -> Diagnosis:
        found = diagnose(folder, command=(sys.executable, "-c", _SPY, *COMMAND[3:]))
        spied.append(json.loads((folder / "spied.json").read_text()))
        return found

    row = examine(Trial.parse(DELAY), tmp_path, answer=spy, keep=True)
    (seen,) = spied
    assert seen["files"] == ["holdout.csv", "model.py", "nominal.json", "sweep.csv"]
    assert Path(seen["cwd"]) == tmp_path / "cases" / Trial.parse(DELAY).folder
    assert "control_delay" not in "".join(
        (Path(seen["cwd"]) / name).read_text() for name in seen["files"]
    )
    # the sweep alone, and no path that leads out of the folder
    assert seen["argv"][1:] == [
        "ibrid",
        "gap",
        "model.py",
        "sweep.csv",
        "--values",
        "nominal.json",
        "--out",
        "answer",
    ]
    assert (row["verdict"], row["failure"]) == ("failed", "exit status 1: spy: seen enough")
    assert list(tmp_path.glob("truths/*/truth.json"))


@pytest.mark.parametrize(
    ("program", "limit", "failure"),
    [
        ("import time; time.sleep(60)", 0.5, "no answer within 0.5 s"),
        ("pass", 600.0, "cannot be read"),
        ("1/0", 600.0, "ZeroDivisionError"),
    ],
)
def test_a_diagnosis_that_ends_without_an_answer_is_a_failure_with_its_reason(
    tmp_path, program, limit, failure
):
    found = diagnose(tmp_path, command=(sys.executable, "-c", program), limit=limit)
    assert failure in found.failure
    row = score(case_of(DELAY), found, SEEN)
    assert (row["verdict"], row["right_verdict"], row["named_first"], row["inside_class"]) == (
        "failed",
        *[False] * 3,
    )
    assert miss(row).startswith("no answer")


# names


def test_the_right_answer_gets_full_marks():
    case = case_of(DELAY)
    T_d = case.truth["effects"][0]["parameters"]["T_d"]
    right = effect("control_delay:add", **{"delay.T_d": [T_d, 0.99 * T_d, 1.01 * T_d]})
    row = answered(case, "named", right, repaired=True)
    assert (row["right_verdict"], row["named_first"], row["inside_class"], row["class_size"]) == (
        True,
        True,
        True,
        1,
    )
    assert row["covered"] == [1, 1, 0]
    assert row["holdout"] < 1e-6  # a model of the device at its true values
    assert (row["extra"], miss(row)) == (0, "")
    assert json.loads(json.dumps(row, allow_nan=False)) == row


def test_a_wrong_name_a_wrong_change_and_a_refusal_are_misses():
    case = case_of(DELAY)
    wrong = answered(case, "named", effect("command_filter:add"))
    assert (wrong["right_verdict"], wrong["named_first"], wrong["inside_class"]) == (
        True,
        False,
        False,
    )
    assert miss(wrong) == "named command_filter:add"
    assert answered(case, "named", effect("control_delay:remove"))["named_first"] is False
    refused = answered(case, "located-unnamed")
    assert (refused["right_verdict"], refused["named_first"], refused["holdout"]) == (
        False,
        False,
        None,
    )
    assert miss(refused) == "located-unnamed"


def test_a_name_among_those_that_cannot_be_told_apart_is_inside_the_class():
    row = answered(
        case_of(DELAY), "named", effect("command_filter:add", "control_delay", "current_filter")
    )
    assert (row["named_first"], row["inside_class"], row["class_size"]) == (False, True, 3)
    assert "or control_delay, current_filter" in miss(row)


def test_the_device_itself_under_another_name_is_named_right():
    row = answered(case_of(DELAY), "named", effect("my_own_delay:add"), repaired=True)
    assert (row["named_first"], row["inside_class"], miss(row)) == (True, True, "")


def test_a_replacement_may_be_called_an_addition_and_not_the_other_way_round():
    voltage = case_of("effect/ac_voltage_loop:replace/clear/60dB/16x2/3")
    assert answered(voltage, "named", effect("ac_voltage_loop:add"))["named_first"] is True
    assert (
        answered(case_of(DELAY), "named", effect("control_delay:replace"))["named_first"] is False
    )


def test_effects_beyond_the_hidden_one_are_counted():
    case = case_of(DELAY)
    row = answered(case, "named", effect("control_delay:add"), effect("power_filter:add"))
    assert (row["named_first"], row["extra"]) == (True, 1)


def test_of_two_effects_each_must_be_in_the_class_of_an_effect_of_its_own():
    pair = case_of("pair/control_delay:add+pll_prefilter:add/clear/60dB/16x2/1")
    delay, filtered = effect("control_delay:add"), effect("voltage_sensor:add", "pll_prefilter")
    assert answered(pair, "named", filtered, delay)["all_named"] is True
    assert answered(pair, "named", delay)["all_named"] is False
    assert (
        answered(pair, "named", effect("control_delay:add", "pll_prefilter"))["all_named"] is False
    )
    assert miss(answered(pair, "named", delay)).endswith("one of two is missing")


def test_a_frame_angle_has_a_name_beside_its_verdict():
    case = case_of("convention/frame_misalignment/clear/60dB/16x2/2")
    angle = case.truth["effects"][0]["parameters"]["frame_angle"]
    right = effect("frame_misalignment:add", angle=[angle, angle - 0.01, angle + 0.01])
    row = answered(case, "data-convention", right)
    assert (row["right_verdict"], row["named_first"], row["covered"]) == (True, True, [1, 1, 0])
    assert answered(case, "data-convention")["named_first"] is False
    assert (
        answered(case_of("convention/q_axis/clear/60dB/16x2/2"), "data-convention")["named_first"]
        is None
    )


# refusals


@pytest.mark.parametrize("kind", ["nothing", "parameters"])
def test_naming_something_where_nothing_is_missing_is_a_false_alarm(kind):
    case = case_of(f"{kind}/any/clear/60dB/16x2/1")
    for verdict, alarm, right in (
        ("no-gap", False, True),
        ("parameters-only", False, True),
        ("unexplained", False, False),
        ("located-unnamed", True, False),
        ("data-convention", True, False),
        ("named", True, False),
    ):
        row = answered(case, verdict)
        assert (row["false_alarm"], row["right_verdict"]) == (alarm, right)
        assert bool(miss(row)) != right
        assert (row["named_first"], row["above"], row["false_name"]) == (None, None, None)


def test_a_name_for_what_is_not_in_the_catalogue_is_a_false_name():
    case = case_of("foreign/comb/clear/60dB/16x2/1")
    model = Diagnosis(
        {"verdict": "named", "effects": [effect("control_delay:add")], "program": case.program},
        None,
        1.0,
    )
    assert score(case, model, SEEN)["false_name"] is True
    located = score(case, replace(model, gap={"verdict": "located-unnamed", "effects": []}), SEEN)
    assert (located["false_name"], located["right_verdict"], miss(located)) == (False, True, "")


def test_what_parameters_absorb_asks_for_no_name():
    row = answered(case_of("effect/series_impedance:add:lcl/clear/60dB/16x2/1"), "parameters-only")
    assert (row["right_verdict"], row["named_first"], miss(row)) == (True, None, "")


def test_below_the_detection_limit_only_a_wrong_name_is_a_miss():
    case = case_of(DELAY)
    silent = Diagnosis({"verdict": "no-gap", "effects": []}, None, 1.0)
    row = score(case, silent, UNSEEN)
    assert (row["above"], miss(row)) == (False, "")
    wrong = {"verdict": "named", "effects": [effect("decoupling:add")], "program": case.program}
    assert "below the detection limit" in miss(score(case, replace(silent, gap=wrong), UNSEEN))


# numbers


@pytest.mark.parametrize(
    ("interval", "counted"),
    [([1.0, 0.9, 1.1], [1, 1, 0]), ([1.2, 1.1, 1.3], [0, 1, 0]), ([1.0, None, None], [0, 0, 1])],
)
def test_an_interval_holds_the_true_value_or_not_or_is_left_open(interval, counted):
    case = case_of(DELAY)
    T_d = case.truth["effects"][0]["parameters"]["T_d"]
    scaled = [None if one is None else one * T_d for one in interval]
    row = answered(
        case, "named", effect("control_delay:add", **{"delay.T_d": scaled}), repaired=True
    )
    assert row["covered"] == counted


def test_values_are_compared_by_structure_whatever_modules_and_signs_are_called():
    case = case_of("effect/active_damping:add:plain/clear/60dB/16x2/1")
    k = case.truth["effects"][0]["parameters"]["k_damping"]
    assert case.truth["device"]["values"]["damping.k"] == -k
    record = record_of(case)
    program = record.program.replace("damping", "damper")
    gap = {"verdict": "named", "effects": [], "program": program}
    for low, high, inside in (
        (0.9 * k, 1.1 * k, 1),
        (-1.1 * k, -0.9 * k, 1),
        (1.1 * k, 1.2 * k, 0),
    ):
        gap["effects"] = [effect("active_damping:add", **{"damper.k": [k, low, high]})]
        assert score(case, Diagnosis(gap, record, 1.0), SEEN)["covered"] == [inside, 1, 0]


def test_the_held_out_error_is_that_of_the_repaired_model_over_the_noise_floor():
    case = case_of(DELAY)
    assert noise_floor(case.sweep) == pytest.approx(1e-3, rel=0.01)  # 60 dB
    (held,) = case.held_out.points
    given = record_of(case, repaired=False)
    error = np.linalg.norm(predicted(given, held.op, held.frequency) - held.admittance)
    expected = error / np.linalg.norm(held.admittance) / noise_floor(case.sweep)
    assert held_out_ratio(given, case) == pytest.approx(expected, rel=1e-3)
    assert expected > 10
    right = effect("control_delay:add")
    assert miss(answered(case, "named", right)).startswith("held-out error")


def test_a_prediction_is_in_the_frame_of_the_data():
    case = case_of("convention/frame_misalignment/gross/clean/16x2/2")
    angle = case.truth["effects"][0]["parameters"]["frame_angle"]
    straight = record_of(case)
    turned = replace(straight, settings={**straight.settings, "frame_angle": angle})
    point = case.held_out.points[0]
    R = rotation(angle)
    expected = R @ predicted(straight, point.op, point.frequency) @ R.T
    np.testing.assert_allclose(predicted(turned, point.op, point.frequency), expected, rtol=1e-12)
    # the clean floor is 1e-4; the model is the device
    assert held_out_ratio(turned, case) < 1e-3
    assert held_out_ratio(straight, case) > 100


def test_a_model_that_has_no_such_operating_point_has_no_held_out_error():
    case = case_of(DELAY)
    record = record_of(case)
    broken = replace(record, parameters={name: {"plant.L_F": 0.1} for name in record.parameters})
    assert held_out_ratio(broken, case) is None


# the detection limit


def visible(key: str) -> tuple[Visibility, ...]:
    trial = Trial.parse(key)
    return visibilities(trial.case(), trial.clean_case(), 1)


def test_the_gain_is_no_more_than_the_misfit_of_the_model_at_its_true_values():
    trial = Trial.parse("effect/decoupling:add:pll/mild/40dB/16x2/5")
    case, clean = trial.case(), trial.clean_case()
    model = record_of(case, repaired=False)
    chi2 = 0.0
    for seen, true in zip(case.sweep.points, clean.sweep.points, strict=True):
        misfit = model.response(true.op.name, true.frequency) - true.admittance
        chi2 += float((np.abs(misfit / seen.sigma) ** 2).sum())
    (found,) = visibilities(case, clean, 1)
    assert LIMIT < found.gain <= chi2
    assert found.above


def test_less_noise_makes_an_effect_easier_to_see_and_no_more_than_in_proportion():
    (coarse,), (fine,) = (
        visible(f"effect/decoupling:add:pll/mild/{data}/16x2/5") for data in ("40dB", "60dB")
    )
    # chi2 grows by 100, the prior not at all
    assert coarse.gain < fine.gain <= 100 * coarse.gain + 100 * abs(coarse.pull)


def test_where_nothing_is_hidden_nothing_is_to_be_seen():
    assert visible("nothing/any/clear/60dB/16x2/1") == ()


def test_of_a_pair_each_effect_is_looked_for_in_a_model_that_has_the_other():
    both = visible("pair/control_delay:add+pll_prefilter:add:low_pass/mild/40dB/16x2/1")
    assert len(both) == 2
    trial = Trial.parse("pair/control_delay:add+pll_prefilter:add:low_pass/mild/40dB/16x2/1")
    case, clean = trial.case(), trial.clean_case()
    told = {
        **case.truth,
        "effects": case.truth["effects"][:1],
    }  # as if the other were no effect to be repaired
    (alone,) = visibilities(replace(case, truth=told), clean, 1)
    assert both[0].gain < alone.gain


def test_a_block_to_be_removed_is_seen_by_how_far_it_leaves_its_nominal_value():
    assert Visibility(LIMIT - 1, REMOVAL_LIMIT, "remove").above
    assert not Visibility(LIMIT - 1, REMOVAL_LIMIT, "add").above
    assert Visibility(LIMIT, 0.0, "add").above
    (found,) = visible("effect/power_filter:remove:p_and_q/mild/60dB/16x2/1")
    # a low-pass driven out of the band: the data are content, the nominal value is not
    assert found.pull > REMOVAL_LIMIT
    assert found.pull > 0.5 * found.gain


# shares and tables


def test_wilsons_interval_is_where_the_observed_share_is_one_that_a_true_one_would_just_give():
    for hits, number in ((27, 28), (3, 10), (0, 20)):
        share = Share(hits, number)
        for limit in share.interval:
            if 0 < limit < 1:
                assert abs(hits / number - limit) == pytest.approx(
                    Z * np.sqrt(limit * (1 - limit) / number), rel=1e-9
                )
    assert Share(0, 10).interval == pytest.approx(
        (0.0, 0.2775), abs=1e-4
    )  # Wilson 1927, Brown et al. 2001
    assert str(Share.of([True, None, False, True])) == "2/3 67% (21-94)"
    assert (str(Share(0, 0)), Share(0, 0).interval) == ("-", (0.0, 1.0))


@shared
def table() -> tuple[Row, ...]:
    """Rows of every kind, right and wrong, as they come from answers."""
    rows = []
    for number, trial in enumerate(design(40, 1)):
        case = trial.case()
        hidden = [effect(f"{one['id']}:{one['change']}") for one in case.truth["effects"]]
        verdict = case.truth["verdicts"][0] if number % 3 else "located-unnamed"
        effects = hidden if verdict in ("named", "data-convention") else []
        if number % 7 == 0:
            verdict, effects = "named", [effect("decoupling:replace", "virtual_impedance")]
        gap = {"verdict": verdict, "effects": effects, "program": case.program}
        seen = (SEEN if number % 5 else UNSEEN) * len(hidden)
        row = score(case, Diagnosis(gap, None, 1.0 + number), seen)
        rows.append({"key": trial.key, **vars(trial), "data": trial.data, **row, "holdout": 0.2})
    return tuple(rows)


def test_the_tables_fit_100_columns_and_count_what_the_rows_say():
    lines = list(report(table()))
    assert max(map(len, lines)) <= WIDTH == 100
    assert lines[0].startswith("40 hidden cases")
    single = [
        row
        for row in table()
        if row["kind"] == "effect" and row["named_first"] is not None and row["above"]
    ]
    main = [row for row in single if (row["frequencies"], row["points"]) == (16, 2)]
    (line,) = [line for line in lines if line.startswith("all three")]
    assert str(Share.of(row["named_first"] for row in main)) in line
    (line,) = [line for line in lines if line.startswith("nothing hidden: false alarm")]
    assert str(Share.of(row["false_alarm"] for row in table())) not in ("", "-")
    assert str(Share.of(row["false_alarm"] for row in table() if row["kind"] == "nothing")) in line


def test_every_miss_is_listed_with_the_trial_that_repeats_it():
    lines = list(report(table()))
    missed = [row for row in table() if miss(row)]
    assert 0 < len(missed) < len(table())
    start = next(k for k, line in enumerate(lines) if line.startswith(f"Misses: {len(missed)}"))
    listed = [line for line in lines[start:] if "/" in line and not line.startswith((" ", "make"))]
    assert listed == [row["key"] for row in missed]
    assert sum(number for *_, number in confusions(table())) <= len(missed)
    assert trial_line(missed[0], 1, 40).split()[:2] == ["1/40", "x"]


def test_a_table_without_misses_says_so():
    right = [row for row in table() if not miss(row)]
    assert list(report(right))[-2] == "No misses"


# the program


def oracle(folder: Path, asked: list[Path] | None = None) -> Diagnosis:
    """Says that nothing is missing, whatever it sees."""
    if asked is not None:
        asked.append(folder)
    return Diagnosis({"verdict": "no-gap", "effects": []}, None, 1.0)


def test_a_finished_benchmark_asks_nothing_again(tmp_path, capsys):
    asked: list[Path] = []
    options = [
        "--cases",
        "6",
        "--only",
        "nothing",
        "--only",
        DELAY,
        "--workers",
        "1",
        "--out",
        str(tmp_path),
    ]
    assert main(options, answer=partial(oracle, asked=asked)) == 0
    first = capsys.readouterr().out
    assert len(asked) == len((tmp_path / "results.jsonl").read_text().splitlines()) == 2
    assert f"x   1.0 s  {DELAY}  no-gap" in first
    assert not list(tmp_path.glob("cases/*"))
    assert not list(tmp_path.glob("truths/*"))
    assert main(options, answer=partial(oracle, asked=asked)) == 0
    assert len(asked) == 2
    assert capsys.readouterr().out == first


def test_two_workers_come_to_the_same_rows_as_one(tmp_path, capsys):
    options = ["--cases", "20", "--only", "nothing", "--only", "parameters", "--out"]
    for workers in ("1", "2"):
        assert main([*options, str(tmp_path / workers), "--workers", workers], answer=oracle) == 0
    capsys.readouterr()
    one, two = (
        sorted((tmp_path / workers / "results.jsonl").read_text().splitlines())
        for workers in ("1", "2")
    )
    assert len(one) == 4
    assert one == two


def test_a_stopped_benchmark_says_how_to_go_on(tmp_path, capsys):
    def stopped(folder: Path) -> Diagnosis:
        raise KeyboardInterrupt

    assert main(["--only", DELAY, "--out", str(tmp_path)], answer=stopped) == 1
    assert f"--out {tmp_path}" in capsys.readouterr().err


def test_a_part_of_the_table_is_asked_for_by_kind_effect_or_trial(tmp_path, capsys):
    table = (*design(200, 5), *unstated(200, 5))
    assert {one.kind for one in wanted(200, 5, ["pair"])} == {"pair"}
    assert wanted(200, 5, [UNSTATED]) == list(unstated(200, 5))
    assert wanted(200, 5, ["dc_link"]) == [
        one for one in table if one.effects and one.effects[0].startswith("dc_link:")
    ]
    assert wanted(200, 5, [table[0].key, table[0].kind])[0] == table[0]
    assert len(wanted(20, 5, [])) == 22 + len(several(20, 5))
    assert main(["--only", "pairs", "--out", str(tmp_path)]) == 2
    assert "pair" in capsys.readouterr().err
