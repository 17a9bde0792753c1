"""A fit to records of events, alone and beside a sweep: truth comes from an independent simulation
of the same device.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.events.cases import draw
from ibrid_bench.events.device import Device, simulate
from sharing import shared

import ibrid
from ibrid.cli import main
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.gap.recordings.event_evaluation import evaluate_events, evaluate_records
from ibrid.gap.recordings.event_fitter import EventFitter
from ibrid.gap.recordings.event_noise import estimate_event_noise
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.sweeping import plant_named
from ibrid.playback.compare import model_of_record, play
from ibrid.playback.limits import LIMITS
from ibrid.playback.recording import event_of, record_events
from ibrid.schemas import breach
from ibrid.study import Study

#: The shipped benchmark, whose sweep is `paper_like`.
NUMBERS = {
    "L_F": 0.15,
    "R_F": 0.005,
    "C_F": 0.066,
    "L_g": 0.15,
    "R_g": 0.01,
    "kP_pll": 60.0,
    "kI_pll": 1400.0,
    "w_pll": 1000 * pi,
    "kP": 0.02,
    "kI": 20.0,
    "kP_c": 0.5,
    "kI_c": 4 * pi,
    "feedforward": 1.0,
    "decoupling": 0.15,
}
#: What every response shows of it; the rest scales together.
VISIBLE = {
    "plant.C_F": 0.066,
    "plant.L_g": 0.15,
    "plant.R_g": 0.01,
    "pll.kP_pll": 60.0,
    "pll.kI_pll": 1400.0,
    "pll_filter.omega_c": 1000 * pi,
    "power.kP": 0.02,
    "power.kI": 20.0,
}
TEXTBOOK = "gfl_pll_filter_exact"
#: Of all its numbers.
TRUTH = {
    **VISIBLE,
    "plant.L_F": 0.15,
    "plant.R_F": 0.005,
    "current.kP": 0.5,
    "current.kI": 4 * pi,
    "decoupling.L": 0.15,
}


@shared
def records(*events: str, u_max: float = 0.0, noise: float = 10**-2.5) -> Events:
    """Of the benchmark at p = 0.8, q = 0.1, with noise of 50 dB; u_max : of a limit of its command,
    none where zero.
    """
    limits = {"command_limit": {"u_max": u_max, "windup": False}} if u_max else {}
    rng, found, time = np.random.default_rng(4), [], np.arange(900) / 5000
    for event in events:
        shape = event_of(event).voltage(time, 1.0)
        v = np.stack([shape.real, shape.imag], axis=1)
        i = simulate(Device(NUMBERS, limits), (0.8, 0.1, 1.0), time, v)
        sigma = noise * float(np.sqrt(np.mean((i - i[0]) ** 2)))
        rest = OperatingPoint(event.split(",")[0], float(i[0, 0]), float(-i[0, 1]), 1.0)
        found.append(EventRecord(rest, time, v, i + sigma * rng.standard_normal(i.shape), 0.0398))
    return Events(tuple(found))


def sweep() -> ibrid.Sweep:
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


def errors(record: Record, values: dict[str, float] = VISIBLE) -> dict[str, float]:
    found = next(iter(record.parameters.values()))
    return {name: abs(found[name] / value - 1.0) for name, value in values.items()}


def inside(record: Record, names: Sequence[str]) -> list[str]:
    """Names whose interval, three times as wide, holds the truth."""
    intervals = next(iter(record.intervals.values()))
    values = next(iter(record.parameters.values()))
    ends = {name: intervals[name] for name in names}
    return [
        name
        for name, span in ends.items()
        if span
        and abs(values[name] - VISIBLE[name])
        <= 3.0 * max(span[1] - values[name], values[name] - span[0])
    ]


@pytest.mark.slow
def test_the_solver_of_record_ends_a_fit_that_stopped_short_and_leaves_one_whose_model_jumps():
    question = build_event_problem(
        ibrid.textbook(TEXTBOOK),
        None,
        VISIBLE,
        records("dip:0.8,at=0.04,for=0.09", "phase:6,at=0.04"),
        {},
    )
    data = question.build_dataset(question.prior())
    fitter, diagram = data.fitter, question.diagram
    ended = fitter.polish(
        fitter.evaluate_values(diagram, (), {**VISIBLE, "pll.kP_pll": 61.0, "power.kI": 19.7})
    )
    value, slopes = ended.misfit.evaluate_objective(ended.x)
    gradient, hessian = slopes()
    gain = 0.5 * gradient @ np.linalg.lstsq(hessian, gradient, rcond=1e-9)[0]  # of a step of Newton
    assert value < 0.55 * ended.measurement_count  # half of chi2, of as many numbers
    assert gain < 1e-3 * value
    freeze = next(limit for limit in LIMITS if limit.id == "pll_freeze")
    jumps = fitter.evaluate_values(diagram, (freeze,), VISIBLE)
    assert fitter.polish(jumps) is jumps


@pytest.mark.slow
def test_coarse_steps_lead_predictions_too_and_differ_where_a_fast_mode_rings():
    question = build_event_problem(
        ibrid.textbook(TEXTBOOK), None, VISIBLE, records("dip:0.8,at=0.04,for=0.09"), {}
    )
    misfit = question.build_dataset(question.prior()).fitter.misfit(question.diagram, ())
    assert not misfit.coarse.is_predicting
    assert misfit.prediction.coarse.is_predicting
    assert misfit.coarse.coarse is misfit.coarse
    x = misfit.parameter_prior.start(VISIBLE)
    assert misfit.coarse_steps_matter(x, 1.0)
    assert not misfit.coarse_steps_matter(x, 1e4)


@shared
def joint() -> Record:
    events = records("dip:0.8,at=0.04,for=0.09", "phase:6,at=0.04", "swell:1.05,at=0.04,for=0.09")
    return evaluate_events(ibrid.textbook(TEXTBOOK), events, sweep(), holdout_op=("swell:1.05",))


@pytest.mark.slow
def test_one_parameter_set_explains_sweep_and_records_and_predicts_the_one_held_out():
    record = joint()
    assert (record.outcome, record.grade) == ("ok", "explains")
    assert max(errors(record).values()) < 1e-3
    assert set(record.nrmse_by_record) == {"dip:0.8", "phase:6", "swell:1.05"}
    assert set(record.holdout) == {"swell:1.05"}
    assert max(record.nrmse_by_record.values()) < 1.2 * 10**-2.5  # the noise
    assert breach(record.to_json(), "record") is None


@pytest.mark.slow
def test_what_neither_sweep_nor_records_see_has_no_interval():
    intervals = next(iter(joint().intervals.values()))
    assert {name for name, span in intervals.items() if span is None} == set(intervals) - set(
        VISIBLE
    )
    assert any("scale together" in sentence for sentence in joint().identifiability)


@pytest.mark.slow
def test_records_alone_tell_what_they_show_within_their_intervals():
    record = evaluate_events(
        ibrid.textbook(TEXTBOOK), records("dip:0.8,at=0.04,for=0.09", "phase:6,at=0.04")
    )
    assert record.grade == "explains"
    assert max(errors(record).values()) < 0.05
    assert inside(record, list(VISIBLE)) == list(VISIBLE)
    assert set(record.nrmse_by_op) == set(record.nrmse_by_record) == {"dip:0.8", "phase:6"}


@pytest.mark.nightly
@each_of("name", ["gfm_droop", "gfm_vsm"])
def test_records_alone_of_a_grid_forming_inverter_are_explained_from_typical_values(name):
    plant = plant_named(name)
    kinds = [
        event_of(text)
        for text in ("dip:0.8,at=0.05,for=0.05", "phase:10,at=0.05", "step:0.05,at=0.05")
    ]
    events = record_events(
        plant, plant.operating_points[:1], kinds, rate=3000.0, length=0.2, noise_db=50.0
    )
    record = evaluate_events(ibrid.parse_program(plant.program), events)
    assert record.over_noise is not None
    assert record.over_noise < 1.1
    found = next(iter(record.parameters.values()))
    for part in ("plant.L_g", "q_droop.k", "virtual_reactance.L"):
        assert abs(found[part] / plant.diagram_values[part] - 1.0) < 0.1, part


@pytest.mark.slow
def test_a_deep_dip_alone_is_explained_though_simulations_of_typical_values_leave_it():
    """The first milliseconds lead to the next ones, and so on; a DC link at half of its voltage
    forgives nothing.
    """
    events = record_events(
        plant_named("gfl_dc_link"),
        [OperatingPoint("it", 1.0, 0.3)],
        [event_of("dip:0.5")],
        length=0.3,
    )
    (measured,), rng = events.records, np.random.default_rng(1)
    sigma = 1e-3 * float(np.sqrt(np.mean((measured.i - measured.i_rest) ** 2)))
    noisy = replace(measured, i=measured.i + sigma * rng.standard_normal(measured.i.shape))
    record = evaluate_events(ibrid.textbook("gfl_dc_link"), replace(events, records=(noisy,)))
    assert record.nrmse == pytest.approx(1e-3, rel=0.1)
    assert record.grade == "explains"


@pytest.mark.slow
def test_a_fit_does_not_end_where_another_structure_leads():
    """Values of a filter of the PLL without its exact angle, whose fit to these records ends far
    from the device.
    """
    plant = plant_named("paper_like")
    kinds = [event_of("dip:0.8,at=0.04,for=0.04"), event_of("phase:8,at=0.04")]
    point = OperatingPoint("part load", 0.8, -0.2)
    study = Study.of(record_events(plant, [point], kinds, rate=3000.0, length=0.12, noise_db=50.0))
    poor = {
        "plant.L_F": 0.14,
        "plant.R_F": 0.00456,
        "plant.C_F": 0.0662,
        "plant.L_g": 0.15,
        "plant.R_g": 0.00844,
        "pll_filter.omega_c": 2940.0,
        "pll.kP_pll": 59.9,
        "pll.kI_pll": 1400.0,
        "power.kP": 0.000718,
        "power.kI": 20.1,
        "current.kP": 0.0393,
        "current.kI": 74100.0,
        "decoupling.L": 1e-05,
    }
    ends = [
        evaluate_records(
            ibrid.parse_program(plant.program), study, FitSettings(restarts=0, hops=0), {"": values}
        ).nrmse
        for values in (poor, plant.diagram_values)
    ]
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)


@pytest.mark.slow
def test_a_twin_of_the_sweep_is_excluded_by_a_record_that_reaches_a_limit_of_the_voltage():
    model, values = ibrid.textbook(TEXTBOOK), {"command_limit.u_max": 1.1}
    assert ibrid.evaluate(model, sweep()).twins
    event = "swell:1.2,at=0.04,for=0.09"
    told = evaluate_events(model, records(event, u_max=1.1), sweep(), values=values)
    assert told.grade == "explains"
    assert told.twins == ()
    assert any("excluded by the records" in sentence for sentence in told.identifiability)
    assert told.settings["large_signal"][0]["parameters"]["u_max"] == pytest.approx(1.1, rel=1e-2)
    left = evaluate_events(model, records("phase:2,at=0.04"), sweep())
    assert left.twins


@pytest.fixture
def file(tmp_path):
    place = tmp_path / "dip.csv"
    write_events(records("dip:0.8,at=0.04,for=0.09", "phase:6,at=0.04"), place)
    return place


@pytest.mark.nightly
def test_a_cessation_among_the_values_is_fitted_though_its_hold_makes_the_cost_jump():
    case = draw("momentary_cessation", 2, 40.0, swept=False)
    told = case.limits["momentary_cessation"]
    nominal = {
        "v_block": 1.05 * told["v_block"],
        "t_hold": 0.85 * told["t_hold"],
        "ramp": 1.15 * told["ramp"],
    }
    values = {
        **case.values,
        **{f"momentary_cessation.{name}": value for name, value in nominal.items()},
    }
    record = evaluate_events(case.diagram, case.events, values=values, holdout_op=(case.held,))
    (limit,) = record.settings["large_signal"]
    assert record.grade == "explains"
    # the voltage swings about the threshold for 8 ms after its return: a lower one with a longer
    # hold lets go at the same time
    assert limit["parameters"]["v_block"] == pytest.approx(told["v_block"], rel=3e-2)
    assert limit["parameters"]["ramp"] == pytest.approx(told["ramp"], rel=1e-2)
    found = model_of_record(record)
    truth = {
        **found.values,
        **{f"momentary_cessation.{name}": value for name, value in told.items()},
    }
    answers = [play(replace(found, values=values), case.events) for values in (found.values, truth)]
    errors = [[one.nrmse for one in playback.records] for playback in answers]
    np.testing.assert_allclose(*errors, rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"momentary_cessation.v_blok": 0.7}, "did you mean momentary_cessation.v_block"),
        ({"momentary_cessation": {"v_block": 0.7}}, "no limit has"),
        ({"momentary_cessation.v_block": {"tolerance": 0.1}}, "must be a number, found None"),
        ({"momentary_cessation.v_block": -0.7}, "must be above zero"),
        ({"momentary_cessation.t_hold": 50}, "see that it is per unit, or in s"),
    ],
)
def test_what_a_limit_does_not_have_is_one_sentence(values, said):
    with pytest.raises(ibrid.IbridError, match=said):
        evaluate_events(ibrid.textbook(TEXTBOOK), records("phase:6,at=0.04"), values=values)


@pytest.mark.slow
def test_a_limit_without_a_place_in_the_program_is_refused_by_fits_and_gaps_alike():
    events, ramp = records("phase:6,at=0.04"), {"reference_ramp.ramp": 1.0}
    for name in ("naive", "gfm_direct_droop"):
        with pytest.raises(ibrid.IbridError, match=r"reference_ramp needs a current controller"):
            evaluate_events(ibrid.textbook(name), events, values=ramp)
        with pytest.raises(ibrid.IbridError, match=r"reference_ramp needs a current controller"):
            ibrid.find_gap(ibrid.textbook(name), None, ramp, events=events)


@pytest.mark.nightly
def test_the_command_shows_errors_by_record_and_draws_them(file, capsys):
    out, page = file.with_name("out.json"), file.with_name("page.html")
    words = ["evaluate", TEXTBOOK, "paper_like", "--events", str(file), "--report", str(page)]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "dip:0.8" in text
    assert "by window" in text
    assert "Records of events" in page.read_text(encoding="utf-8")
    assert main(["evaluate", TEXTBOOK, str(file), "--json", str(out)]) == 0
    record = json.loads(out.read_text())
    assert set(record["nrmse_by_window"]) >= {"pre", "first cycle"}
    assert (
        main(
            ["predict", str(out), "--events", str(file), "--out", str(file.with_name("answer.csv"))]
        )
        == 0
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("paper_like", "--values", "x.json"), "--values is for records of events"),
        (("paper_like", "--base", "10kVA,400V"), "--channels and --base are of records"),
        (("paper_like", "--events", "FILE", "--json", "FILE"), "would overwrite --events"),
        (("FILE", "--events", "FILE"), "holds records of events, as --events does"),
        (("FILE", "--objective", "nrmse"), "no --objective but the usual"),
        (("FILE", "--parameters", "per-op"), "no --parameters but the usual"),
        (("FILE", "--holdout-op", "dip:8"), "have no record 'dip:8' to hold out"),
        (("paper_like", "--events", "nosuch.csv"), "there is none"),
    ],
)
def test_what_a_fit_to_records_does_not_know_is_one_sentence(file, capsys, words, said):
    assert (
        main(["evaluate", TEXTBOOK, *(str(file) if word == "FILE" else word for word in words)])
        == 2
    )
    assert said in capsys.readouterr().err


def test_far_from_the_noise_a_fast_record_is_fitted_by_fewer_samples_and_a_slow_one_by_all():
    fitters = {
        rate: EventFitter(estimate_event_noise(one, one.rests), VOCABULARY, {}, None)
        for rate, one in ((20_000, fast_record()), (5_000, records("dip:0.5,at=0.04,rise=0.002")))
    }
    slow = fitters[5_000].misfit(ibrid.textbook(TEXTBOOK), ())
    assert slow.decimated is slow
    fast = fitters[20_000].misfit(ibrid.textbook(TEXTBOOK), ())
    time = fast.decimated.noise.events.records[0].time
    assert np.diff(time) == pytest.approx(2e-4)
    wrong, right = ({**TRUTH, "plant.L_g": TRUTH["plant.L_g"] * factor} for factor in (1.005, 1.0))
    costs = [
        fast.decimated.start_descents_from([one], 1)[0].cost / fast.decimated.count
        for one in (wrong, right)
    ]
    assert costs[0] > 10
    assert costs[1] < 1.5
    begun = fast.start_descents_from([wrong], 1)[0]
    begun.run(8, 3)
    assert begun.cost < 1.1 * fast.count


def fast_record() -> Events:
    """The benchmark's answer to a dip at 20,000 samples per s, with noise of 50 dB."""
    rng, time = np.random.default_rng(5), np.arange(3600) / 20_000
    shape = event_of("dip:0.5,at=0.04,rise=0.002").voltage(time, 1.0)
    v = np.stack([shape.real, shape.imag], axis=1)
    i = simulate(Device(NUMBERS), (0.8, 0.1, 1.0), time, v)
    sigma = 10**-2.5 * float(np.sqrt(np.mean((i - i[0]) ** 2)))
    rest = OperatingPoint("dip", float(i[0, 0]), float(-i[0, 1]), 1.0)
    return Events((EventRecord(rest, time, v, i + sigma * rng.standard_normal(i.shape), 0.0398),))
