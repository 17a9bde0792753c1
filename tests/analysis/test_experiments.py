"""What to measure next: closed forms of what a sweep tells, and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fitted import benchmark, evaluated
from sharing import shared

import ibrid
from ibrid.analysis.models.parametric import ParametricModel
from ibrid.analysis.new_data.experiments import (
    ASSUMED_NOISE,
    Among,
    experiments,
    sentences,
    with_twins,
)
from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.recordings.event_evaluation import evaluate_events
from ibrid.plants.sweeping import operating_point, plant_named
from ibrid.playback.compare import model_of_record, play
from ibrid.playback.recording import event_of, record_events
from ibrid.ranges import LIMITS
from ibrid.report.texts.experiments_text import format_experiments
from ibrid.schemas import breach

HERE = Among(p=(1.0,), q=(0.3,), count=6, of=12, noise=0.01, events=())


@shared
def noisy() -> Record:
    data = ibrid.add_noise(benchmark(), 40.0, rng=np.random.default_rng(0))
    return ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), data, objective="sigma")


def only_uncertain(record: Record, name: str, deviation: float) -> Record:
    """The record whose covariance holds one parameter alone."""
    names = list(record.covariance["names"])
    matrix = np.zeros((len(names), len(names)))
    matrix[names.index(name), names.index(name)] = deviation**2
    return replace(record, covariance={"of": "", "names": names, "matrix": matrix.tolist()})


def with_value(record: Record, name: str, factor: float) -> Record:
    changed = {
        op: {**values, name: values[name] * factor} for op, values in record.parameters.items()
    }
    return replace(record, parameters=changed)


def test_one_uncertain_parameter_gains_what_its_slope_says():
    record = only_uncertain(evaluated("gfl_pll_filter_exact"), "pll.kP_pll", 0.02)
    found = experiments([record], ["a"], HERE)[0]
    frequency = np.array(found.frequencies)
    model = ParametricModel(record, benchmark().points[0].op)
    slope = model.slopes(frequency)[..., model.names.index("pll.kP_pll")]
    deviation = 0.01 * np.linalg.norm(model.admittance(frequency), axis=(1, 2)) / np.sqrt(8.0)
    seen = float((np.abs(slope / deviation[:, None, None]) ** 2).sum())
    assert found.gain["pll.kP_pll"] == pytest.approx((1 + 0.02**2 * seen) ** -0.5, rel=1e-3)
    assert found.information == pytest.approx(0.5 * np.log2(1 + 0.02**2 * seen), rel=1e-3)


def test_the_frequencies_of_one_parameter_are_those_that_see_it_best():
    record = only_uncertain(evaluated("gfl_pll_filter_exact"), "pll.kP_pll", 0.02)
    found = experiments([record], ["a"], HERE)[0]
    every = experiments([record], ["a"], replace(HERE, count=12))[0].frequencies
    model = ParametricModel(record, benchmark().points[0].op)
    slope = model.slopes(np.array(every))[..., model.names.index("pll.kP_pll")]
    size = np.linalg.norm(slope, axis=(1, 2)) / np.linalg.norm(
        model.admittance(np.array(every)), axis=(1, 2)
    )
    assert found.frequencies == tuple(every[k] for k in np.sort(np.argsort(size)[-6:]))


def test_two_models_without_a_free_number_are_as_many_bits_apart_as_their_distance_in_noise():
    one = only_uncertain(evaluated("gfl_pll_filter_exact"), "pll.kP_pll", 0.0)
    other = with_value(one, "pll.kP_pll", 1.05)
    (found,) = experiments([one, other], ["a", "b"], HERE)
    frequency = np.array(found.frequencies)
    answers = [
        ParametricModel(each, benchmark().points[0].op).admittance(frequency)
        for each in (one, other)
    ]
    deviation = 0.01 * np.linalg.norm(answers[0], axis=(1, 2)) / np.sqrt(8.0)
    square = float((np.abs((answers[1] - answers[0]) / deviation[:, None, None]) ** 2).sum())
    assert found.separates[0][2] == pytest.approx(square / (2 * np.log(2)), rel=1e-3)


def test_what_is_no_finite_number_is_not_ranked():
    with np.errstate(all="ignore"), pytest.raises(IbridError, match="no finite number"):
        experiments([noisy()], ["a"], replace(HERE, noise=1e-320))
    (least,) = experiments([noisy()], ["a"], replace(HERE, noise=LIMITS["relative_noise"].lower))
    assert np.isfinite([least.information, *least.gain.values()]).all()


def test_sentences_name_a_twin_by_eight_digits_of_its_hash():
    record = replace(only_uncertain(noisy(), "pll.kP_pll", 0.0), twins=({},))
    names, records = with_twins(["0123456789abcdef"], [record])
    (said, *_) = sentences(experiments(records, names, HERE), HERE)
    assert "will tell 01234567 from twin 1 of 01234567, of all" in said


def test_a_rival_that_can_follow_is_not_told_apart_and_the_answer_says_so():
    name = "pll.kP_pll"
    one, other = (only_uncertain(evaluated("gfl_pll_filter_exact"), name, 10.0) for _ in range(2))
    found = experiments([one, with_value(other, name, 1.001)], ["a", "b"], HERE)
    assert found[0].decides() < 0.01
    assert sentences(found, HERE)[0].startswith(
        "nothing you can do at the terminals will tell a from b"
    )


@pytest.mark.slow
def test_bits_that_tell_nothing_neither_rank_nor_are_told():
    """A rival that differs by 1e-6 is some 1e-9 bits away: then all is as if there were no
    rival.
    """
    record, among = noisy(), Among(p=(0.5, 1.0), count=3, of=12, events=())
    alone, beside = (
        experiments(records, ["a", "b"][: len(records)], among)
        for records in ([record], [record, with_value(record, "pll.kP_pll", 1 + 1e-6)])
    )
    assert all(0 < one.separates[0][2] < 1e-3 for one in beside)
    assert [(one.op, one.frequencies) for one in beside] == [
        (one.op, one.frequencies) for one in alone
    ]
    text = format_experiments(beside, ())
    assert "it tells most of" in text
    assert "bits are odds" not in text


@pytest.mark.slow
def test_what_is_asked_for_a_named_parameter_tells_most_of_it():
    record, among = noisy(), Among(p=(0.5, 1.0), count=3, of=12, events=())
    for name in ("pll.kI_pll", "power.kI", "current.kI"):
        asked = replace(among, parameters=(name,))
        best = experiments([record], ["a"], asked)[0]
        assert f"it tells most of {name} (deviation x" in format_experiments([best], (), (name,))
        assert best.gain[name] < experiments([record], ["a"], among)[0].gain[name]
    with pytest.raises(IbridError, match=r"no free parameter 'pll\.kI'"):
        experiments([record], ["a"], replace(among, parameters=("pll.kI",)))


@pytest.mark.slow
def test_twins_are_rivals_and_one_that_nothing_tells_does_not_hide_what_tells_another():
    record = noisy()
    value = next(iter(record.parameters.values()))["pll.kP_pll"]
    among = Among(p=(0.5, 1.0), count=4, of=12, events=())
    far, same = {"pll.kP_pll": 3.0 * value}, {"pll.kP_pll": value}
    answers = {}
    for twins in ((far,), (far, same)):
        names, records = with_twins(["a"], [replace(record, twins=twins)])
        assert names == ("a", "twin 1 of a", "twin 2 of a")[: len(names)]
        answers[len(twins)] = experiments(records, names, among)
        assert (
            sum("will tell" in one for one in sentences(answers[len(twins)], among))
            == len(twins) - 1
        )
    assert [(one.op, one.frequencies) for one in answers[2]] == [
        (one.op, one.frequencies) for one in answers[1]
    ]
    assert ("a", "twin 2 of a", pytest.approx(0.0, abs=1e-9)) in answers[2][0].separates


@pytest.mark.slow
def test_a_noisy_fit_gains_at_points_that_were_not_measured():
    found = experiments([noisy()], ["a"], Among(count=8, events=()))
    assert {one.op.p for one in found} == {0.5, 1.0}  # at p = 0 the model is unstable
    assert [one.information for one in found] == sorted(
        (one.information for one in found), reverse=True
    )
    assert min(found[0].gain.values()) < 0.9
    assert all(0 < ratio <= 1 for ratio in found[0].gain.values())


def test_the_noise_of_the_record_is_that_of_the_measurement_to_come():
    known = experiments([noisy()], ["a"], Among(p=(0.5,), q=(0.0,), events=()))[0]
    said = experiments([noisy()], ["a"], Among(p=(0.5,), q=(0.0,), noise=0.01, events=()))[0]
    assert known.information == pytest.approx(
        said.information, rel=0.02
    )  # 40 dB; the floor is over all frequencies
    assert pytest.approx(0.01) == ASSUMED_NOISE


@pytest.mark.slow
def test_a_record_gains_what_a_fit_to_it_gains():
    """The promise of `next` against the intervals of a joint fit to a record made by the device
    afterwards; at 60 dB, where the fits are as linear as their covariance says.
    """
    data = ibrid.add_noise(benchmark(), 60.0, rng=np.random.default_rng(0))
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), data)
    asked = Among(p=(0.7,), q=(0.1,), count=1, events=("dip:0.7",), record_noise=0.001)
    (told,) = [one for one in experiments([record], ["a"], asked) if one.event]
    op = operating_point("p=0.7,q=0.1")
    events = record_events(plant_named("paper_like"), [op], [event_of("dip:0.7")], noise_db=60.0)
    both = evaluate_events(ibrid.textbook("gfl_pll_filter_exact"), events, data)
    gains = {name: gain for name, gain in told.gain.items() if gain < 0.8}
    kept = {name: deviation(both, name) / deviation(record, name) for name in gains}
    assert len(gains) > 7
    assert kept == pytest.approx(gains, rel=0.1)


@pytest.mark.slow
def test_a_step_of_a_set_point_tells_of_the_loop_that_follows_it():
    """The slope two ways; what sampling leaves open is a twentieth of the noise."""
    name, event = "power.kI", "p_ref:0.5"
    record = only_uncertain(evaluated("gfl_pll_filter_exact"), name, 0.02)
    op = operating_point("p=0.7,q=0.1")
    asked = Among(p=(0.7,), q=(0.1,), count=1, events=(event,), record_noise=0.1)
    (ranked,) = [one for one in experiments([record], ["a"], asked) if one.event]
    recorded = record_events(plant_named("paper_like"), [op], [event_of(event)])
    lower, nominal, higher = (
        play(model_of_record(with_value(record, name, factor)), recorded).records[0].current
        for factor in (0.999, 1.0, 1.001)
    )
    deviation = 0.1 * np.sqrt(np.mean((nominal - nominal[0]) ** 2))
    seen = float((((higher - lower) / 0.002 / deviation) ** 2).sum())
    assert ranked.gain[name] == pytest.approx((1 + 0.02**2 * seen) ** -0.5, rel=0.02)
    assert ranked.gain[name] < 0.9


@pytest.mark.slow
def test_an_event_in_which_the_model_leaves_is_told_and_the_others_are_asked():
    asked = Among(p=(0.7,), q=(0.1,), count=1, events=("swell:9", "phase:20"))
    found = experiments([noisy()], ["a"], asked)
    assert {one.event for one in found} == {"", "phase:20"}
    assert sentences(found, asked)[0].startswith("swell:9 could not be asked")


def deviation(record: Record, name: str) -> float:
    """Relative, of a positive parameter."""
    k = list(record.covariance["names"]).index(name)
    return float(np.sqrt(record.covariance["matrix"][k][k]))


def test_what_cannot_be_asked_is_refused():
    with pytest.raises(IbridError, match="no operating point can be asked"):
        experiments([noisy()], ["a"], Among(p=(9.0,), q=(0.0,)))
    with pytest.raises(IbridError, match="from low to high"):
        experiments([noisy()], ["a"], Among(low=100.0, high=10.0))


@pytest.mark.slow
def test_the_command_prints_a_ranking_and_its_json(tmp_path, capsys):
    noisy().write(tmp_path / "record.json")
    (tmp_path / "among.toml").write_text("p = [0.5, 1]\nq = 0\ncount = 4\n", encoding="utf-8")
    words = ["next", str(tmp_path / "record.json"), "--among", str(tmp_path / "among.toml")]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert told.startswith("record dip:0.7 at p=")
    assert (
        "will tell" in told
    )  # the two PI controllers may have changed places, which no sweep tells
    assert main([*words, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert breach(content, "next") is None
    sweeps = [one for one in content["experiments"] if one["kind"] == "sweep"]
    assert [len(one["frequencies"]) for one in sweeps] == [4, 4]
    events = {one["event"] for one in content["experiments"] if one["kind"] == "event"}
    assert events == {"dip:0.7", "phase:20"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("p = [", "must be toml"),
        ("power = 1", "knows count, events, high, low, noise, p, parameters, q, record_noise, v"),
        ("p = [99]", "p must be one to twenty numbers"),
        ("v = [0]", "v must be"),
        ("count = 0", "count must be a whole number"),
        ('events = ["dip"]', "an event is written dip:0.6"),
        ('events = ["dip:0.5,for=1e6"]', "must be 0 to 20 s; found 1e+06"),
        ("events = 3", "events must be a list such as"),
        ('parameters = "pll.kI_pll"', "parameters must be a list such as"),
        ('parameters = ["pll.kI"]', "no free parameter 'pll.kI'"),
        ("noise = -1", "noise must be a positive number"),
        ("noise = 1e-320", "noise must be 1e-06 to 1e+06 of what is measured"),
        ("record_noise = 1e-320", "record_noise must be 1e-06 to 1e+06 of what is measured"),
        ("low = 1e-320", "low must be 1e-12 to 1e+12 Hz"),
    ],
)
def test_a_wrong_file_of_possibilities_gets_one_sentence(tmp_path, capsys, text, words):
    noisy().write(tmp_path / "record.json")
    (tmp_path / "among.toml").write_text(text, encoding="utf-8")
    assert (
        main(["next", str(tmp_path / "record.json"), "--among", str(tmp_path / "among.toml")]) == 2
    )
    told = capsys.readouterr().err
    assert words in told
    assert len(told.splitlines()) == 1
