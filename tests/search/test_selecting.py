"""Choosing the answer: the front, what fits as well, and what data that no fit has seen say."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitted import evaluated, measured
from ibrid_search.evaluation.assess import Assessor
from ibrid_search.run.run_folder import write_best
from ibrid_search.run.selection import read_selection
from ibrid_search.screening.selection_criterion import NoiseFloor, estimate_noise_floor
from ibrid_search.selection.rivals import open_structures, rivals_of
from ibrid_search.selection.selecting import MOST, select
from ibrid_search.step import Status, Step
from scripted_search import QUICK
from sharing import shared

import ibrid
from ibrid.errors import IbridError
from ibrid.evaluation.errors_by_part import nrmse
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.amplitudes import EVERY
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.study import Study
from ibrid.writing import json_lines

HELD = "p=0.5,q=0"
SWEEP = measured(["p=1,q=0.3", "p=1,q=-0.3", HELD])
SUBJECT = Assessor(Study(SWEEP, holdout_op=(HELD,)), quick=QUICK)
NAMES = ("naive", "gfl_exact", "gfl_pll_filter_exact")
NAIVE, NEARLY, TRUE = range(3)


@shared
def record(number: int) -> Record:
    return SUBJECT.record_of(ibrid.program_text(ibrid.textbook(NAMES[number])), QUICK)


def step_of(number: int, found: Record, **changes) -> Step:
    one = Step(
        number=number,
        status=Status.OK,
        program=found.program,
        nrmse=found.nrmse,
        reward=found.reward,
        stable=all(found.stable.values()),
        order=found.order,
        free=found.free_parameters,
        note=f"step {number}",
    )
    return replace(one, **changes)


def steps() -> list[Step]:
    return [step_of(number, record(number)) for number in range(3)]


FLOOR = estimate_noise_floor(SWEEP)


def errors_of(given):
    """NRMSE by number of the step."""
    return lambda number: given[number].nrmse


def chosen(
    way: str = "error", best: int = TRUE, given: list[Step] | None = None, records=record
) -> dict:
    given = given or steps()
    return select(given, given[best], records, SUBJECT, FLOOR, errors_of(given), way)


def by_step(found: dict) -> dict[int, dict]:
    return {one["step"]: one for one in found["front"]}


@pytest.mark.slow
def test_by_error_the_answer_is_the_best_of_the_run():
    found = chosen()
    assert found["answer"] == TRUE
    assert [one["step"] for one in found["front"]] == [TRUE, NEARLY, NAIVE]
    assert found["front"][0]["nrmse"] == record(TRUE).nrmse


def test_every_number_of_the_front_is_there():
    for one in chosen()["front"]:
        found = record(one["step"])
        assert (one["order"], one["free_parameters"]) == (found.order, found.free_parameters)
        assert one["holdout"] == pytest.approx(found.holdout[HELD])
        poles = [complex(*pole) for poles in found.poles.values() for pole in poles]
        assert one["damping"] == pytest.approx(min(-pole.real / abs(pole) for pole in poles))
        assert one["note"] == f"step {one['step']}"
        assert one["stable"] is True


@pytest.mark.slow
def test_passivity_is_that_of_the_response_over_the_measured_band():
    one = by_step(chosen())[TRUE]
    frequency = np.geomspace(5, 5000, 400)
    least = np.inf
    for op in record(TRUE).stable:
        y = record(TRUE).response(op, frequency)
        least = min(least, np.linalg.eigvalsh(-(y + np.conj(np.swapaxes(y, 1, 2))) / 2).min())
    # two grids over the same band; lightly damped peaks are met to some percent
    assert one["passivity"] == pytest.approx(least, rel=0.1)


@pytest.mark.slow
def test_held_out_data_can_overrule_the_criterion():
    for way in ("frequencies", "op"):
        found = chosen(way, best=NAIVE)
        assert found["answer"] == TRUE
        assert "held-out" in found["why"]
    assert chosen(best=NAIVE)["answer"] == NAIVE


def test_of_equal_errors_at_held_out_data_the_smaller_structure_is_the_answer():
    alike = dict.fromkeys([HELD], 0.01)
    found = chosen("op", records=lambda number: replace(record(number), holdout=alike))
    assert found["answer"] == NAIVE


@pytest.mark.slow
def test_without_held_out_points_the_criterion_decides():
    found = chosen("op", best=NEARLY, records=lambda number: replace(record(number), holdout={}))
    assert found["answer"] == NEARLY
    assert by_step(found)[TRUE]["holdout"] is None


def test_a_model_without_the_held_out_point_is_not_chosen_for_it():
    def some(number: int) -> Record:
        return replace(record(number), holdout={HELD: None}) if number == TRUE else record(number)

    found = chosen("op", records=some)
    assert by_step(found)[TRUE]["holdout"] is None
    assert found["answer"] == NEARLY


@pytest.mark.slow
@pytest.mark.parametrize("way", ["error", "frequencies", "op"])
def test_an_unstable_structure_is_neither_on_the_front_nor_the_answer(way):
    given = steps()
    given[TRUE] = replace(given[TRUE], stable=False)
    found = chosen(way, best=NEARLY, given=given)
    assert found["answer"] == NEARLY
    assert TRUE not in by_step(found)
    assert TRUE not in found["equally_good"]


def test_a_refused_structure_is_not_on_the_front():
    given = steps()
    given[TRUE] = replace(given[TRUE], status=Status.REQUIRED)
    assert TRUE not in by_step(chosen(best=NEARLY, given=given))


@pytest.mark.slow
def test_the_error_at_held_out_frequencies_is_that_of_a_refit_without_them():
    thin, held = [], []
    for point in SWEEP.points[:2]:
        out = np.arange(len(point.frequency)) % EVERY == EVERY // 2
        thin.append(
            replace(point, frequency=point.frequency[~out], admittance=point.admittance[~out])
        )
        held.append(
            replace(point, frequency=point.frequency[out], admittance=point.admittance[out])
        )
    assert held[0].frequency[0] > 5
    assert held[0].frequency[-1] < 5000
    again = replace(SUBJECT, study=Study(replace(SWEEP, points=tuple(thin)))).record_of(
        record(NEARLY).program, QUICK, record(NEARLY).parameters
    )
    wanted = np.mean(
        [nrmse(again.response(point.op.name, point.frequency), point) for point in held]
    )
    assert by_step(chosen())[NEARLY]["frequencies"] == pytest.approx(wanted)


def test_too_few_frequencies_are_not_divided():
    points = tuple(
        replace(one, frequency=one.frequency[::3], admittance=one.admittance[::3])
        for one in SWEEP.points
    )
    few = replace(SUBJECT, study=Study(replace(SWEEP, points=points)))
    found = select(steps(), steps()[TRUE], record, few, FLOOR, errors_of(steps()), "frequencies")
    assert all(one["frequencies"] is None for one in found["front"])
    assert found["answer"] == TRUE


@pytest.mark.slow
def test_structures_that_fit_equally_well_are_named():
    given = [*steps(), step_of(3, record(TRUE)), step_of(4, record(TRUE), nrmse=0.5)]
    assert chosen(given=given)["equally_good"] == [TRUE, 3]


def test_within_the_noise_everything_fits_equally_well():
    given = steps()
    coarse = NoiseFloor(2.0, 128, "sigma")
    found = select(given, given[TRUE], record, SUBJECT, coarse, errors_of(given), "error")
    assert found["equally_good"] == [NAIVE, NEARLY, TRUE]


@pytest.mark.slow
def test_of_a_long_front_the_least_errors_are_looked_at_and_the_best_always():
    number = MOST + 4
    given = [
        step_of(k, record(NAIVE), nrmse=0.9 - 0.05 * k, order=k, free=k) for k in range(number)
    ]
    found = select(
        given,
        given[0],
        lambda _: record(NAIVE),
        replace(SUBJECT, study=Study(SWEEP)),
        FLOOR,
        errors_of(given),
        "error",
    )
    assert {one["step"] for one in found["front"]} == {0, *range(number - MOST, number)}


@pytest.mark.slow
def test_modules_that_stand_for_no_physics_are_named():
    residual = replace(record(NAIVE), program=record(NAIVE).program.replace("Gain_dq", "Pade1_dq"))
    # the numbers of the front are those of the naive diagram; only the answer is asked for its
    # modules
    asked = iter([record(NAIVE), residual])
    given = [step_of(0, record(NAIVE))]
    found = select(
        given, given[0], lambda _: next(asked), SUBJECT, FLOOR, errors_of(given), "error"
    )
    assert found["residual_modules"] == ["gain"]
    assert chosen()["residual_modules"] == []


@pytest.mark.slow
def test_the_file_says_the_same_when_it_is_read(tmp_path):
    found = chosen()
    path = tmp_path / "selection.json"
    path.write_text(json_lines(found), encoding="utf-8")
    assert json.loads(path.read_text(encoding="utf-8")) == found
    again = read_selection(path)
    assert again is not None
    assert (again.answer, again.equally_good) == (found["answer"], tuple(found["equally_good"]))
    assert [one.step for one in again.front] == [one["step"] for one in found["front"]]


@pytest.mark.slow
def test_of_held_out_errors_within_the_noise_the_smaller_structure_is_the_answer():
    held = {NAIVE: 0.019, NEARLY: 0.010, TRUE: 0.0099}
    records = lambda number: replace(record(number), holdout={HELD: held[number]})  # noqa: E731
    given = steps()
    found = select(
        given,
        given[TRUE],
        records,
        SUBJECT,
        NoiseFloor(0.01, 10_000, "sigma"),
        errors_of(given),
        "plausible",
    )
    assert found["answer"] == NEARLY
    found = select(
        given,
        given[TRUE],
        records,
        SUBJECT,
        NoiseFloor(0.02, 10_000, "sigma"),
        errors_of(given),
        "plausible",
    )
    assert found["answer"] == NAIVE


def rivals(given: list[Step], floor: NoiseFloor = FLOOR, records=record) -> list[int]:
    return [rival.step for rival in rivals_of(given[TRUE], given, records, floor)]


@pytest.mark.slow
def test_a_rival_fits_as_well_with_no_more_numbers_and_another_structure():
    given = [replace(step, hash=f"structure {step.number}") for step in steps()]
    assert rivals(given) == []
    same = replace(given[TRUE], number=3)
    assert rivals([*given, same]) == []  # the same structure is none
    other = replace(same, hash="another")
    assert rivals([*given, other], records=lambda number: record(min(number, TRUE))) == [3]
    larger = replace(other, free=int(other.free or 0) + 1)
    assert rivals([*given, larger], records=lambda number: record(min(number, TRUE))) == []


@pytest.mark.slow
def test_with_known_noise_the_odds_are_those_of_the_information_criterion():
    given = [replace(step, hash=f"structure {step.number}") for step in steps()]
    floor, misfits = NoiseFloor(0.01, 1_000, "sigma"), {TRUE: 1.0, NEARLY: 1.0}
    records = lambda number: replace(record(number), over_noise=misfits.get(number, 9.0))  # noqa: E731
    free = [record(number).free_parameters for number in (NEARLY, TRUE)]
    assert free[0] < free[1]
    (rival,) = rivals_of(given[TRUE], given, records, floor)
    assert rival.step == NEARLY
    assert rival.odds == pytest.approx(1_000 ** ((free[0] - free[1]) / 2))
    misfits[NEARLY] = 1.1
    assert rivals(given, floor, records) == []


@pytest.mark.slow
def test_where_two_models_differ_most_is_named():
    given = [replace(step, hash=f"structure {step.number}") for step in steps()]
    records = lambda number: replace(record(number), over_noise=1.0)  # noqa: E731
    rival = next(
        one
        for one in rivals_of(given[TRUE], given, records, NoiseFloor(0.01, 1_000, "sigma"))
        if one.step == NEARLY
    )
    assert rival.op is not None
    assert rival.hz is not None
    p, q = (float(part.split(" = ")[1]) for part in rival.op.split(", "))
    y = [
        ibrid.predict(record(number), f"p={p},q={q}", np.array([rival.hz])).admittance[0]
        for number in (TRUE, NEARLY)
    ]
    assert rival.differs == pytest.approx(np.linalg.norm(y[0] - y[1]) / np.linalg.norm(y[0]))
    assert "would tell" in rival.words(rival.differs / 2)
    assert "no sweep" in rival.words(rival.differs * 2)


def test_of_a_stopped_run_the_best_so_far_is_the_open_structure(tmp_path: Path):
    with pytest.raises(IbridError, match="the search has no answer yet"):
        open_structures(tmp_path)
    best = evaluated("gfl_exact")
    write_best(tmp_path, best)
    names, (record,) = open_structures(tmp_path)
    assert record.to_json() == best.to_json()
    assert names == (structure_hash(best.diagram, best.vocabulary),)
