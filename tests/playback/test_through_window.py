"""Frames of estimators played and fitted: the model sees the voltage before the estimator, and is
seen through its window.
"""

from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid.cli import main
from ibrid.gap.recordings.event_evaluation import evaluate_events
from ibrid.gap.recordings.event_noise import estimate_event_noise
from ibrid.measurement.estimators.window import window_of
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.event_samples import seen_through
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.plants.sweeping import operating_point, plant_named
from ibrid.playback.compare import model_of_program, nrmse, play
from ibrid.playback.recording import event_of, record_events

F0 = 60.0
PLANT = plant_named("paper_like")
VALUES = dict(PLANT.diagram_values)


@pytest.fixture(scope="module")
def waveform() -> EventRecord:
    """A dip and its return at 5 kHz."""
    events = [event_of("dip:0.6,at=0.5033,for=0.15")]
    return record_events(PLANT, [operating_point("p=0.8,q=0.1")], events, length=1.5).records[0]


def frames(
    waveform: EventRecord, said: str, rate: float, noise: float = 0.0, seed: int = 0
) -> Events:
    """What an estimator makes of a waveform; noise : standard deviation of each component behind
    its window.
    """
    window, rng = window_of(said, F0), np.random.default_rng(seed)
    tags = np.arange(0.0, waveform.time[-1] - 0.05, 1.0 / rate)
    shows = window.matrix(tags, waveform.time)
    samples = np.arange(-1.0, 2.0, 1.0 / (16 * F0))
    of_noise = window.matrix(tags, samples)
    unit = np.sqrt(of_noise.multiply(of_noise).sum(axis=1).mean())
    v, i = (
        shows @ wave + noise / unit * (of_noise @ rng.standard_normal((len(samples), 2)))
        for wave in (waveform.v, waveform.i)
    )
    rest_end = float(tags[tags < waveform.rest_end - window.span][-1])
    record = EventRecord(waveform.rest, tags, v, i, rest_end, f0_hz=F0, window=window)
    return Events((seen_through(record),), f0_hz=F0, power_node="pcc")


@pytest.mark.parametrize(
    ("said", "rate"),
    [
        ("c37.118-P:60", 60.0),
        ("c37.118-M:60", 60.0),
        ("dft:1", 1000.0),
        ("first_order:0.02", 200.0),
    ],
)
def test_the_right_model_seen_through_the_window_gives_the_frames(
    waveform: EventRecord, said: str, rate: float
):
    events = frames(waveform, said, rate)
    playback = play(model_of_program(ibrid.parse_program(PLANT.program), VALUES), events)
    assert playback.nrmse is not None
    assert playback.nrmse < 0.01  # of a jump whose moment is known to half a millisecond
    record = events.records[0]
    spline = EventRecord(record.rest, record.time, record.v, record.i, record.rest_end, f0_hz=0.0)
    as_waveform = play(playback.model, Events((spline,), f0_hz=F0)).nrmse
    assert as_waveform is None or as_waveform > playback.nrmse


def test_noise_behind_a_window_is_all_that_the_right_values_leave(waveform: EventRecord):
    events = frames(waveform, "c37.118-P:60", 60.0, noise=2e-3)
    program = ibrid.parse_program(PLANT.program)
    fixed = {name: {"value": value, "tolerance": 1e-3} for name, value in VALUES.items()}
    record = evaluate_events(program, events, values=fixed, settings=ibrid.FitSettings(restarts=0))
    assert record.grade == "explains"
    assert 0.6 < record.misfit["chi2_per_dof"] < 1.4


def test_fast_frames_are_judged_by_all_of_their_samples(waveform: EventRecord):
    window, tags = window_of("dft:1", F0), np.arange(0.4, 0.6, 1.0 / 20e3)
    shows = window.matrix(tags, waveform.time)
    record = EventRecord(
        waveform.rest, tags, shows @ waveform.v, shows @ waveform.i, 0.48, f0_hz=F0, window=window
    )
    events = Events((record,), f0_hz=F0)
    noise = estimate_event_noise(events, events.rests)
    for one in (noise.for_predictions, noise.decimated):
        assert one.events.records[0].v.shape == one.of[record.name].sigma.shape == record.v.shape


def test_a_record_of_which_every_frame_that_moves_is_left_out_has_no_error(waveform: EventRecord):
    record = frames(waveform, "c37.118-P:60", 60.0).records[0]
    vars(record)["masked"] = np.ones(len(record.time), dtype=bool)
    assert nrmse(record.i, record) is None
    assert "stays at rest in the frames that are not left out" in record.still


def test_playback_takes_frames(waveform: EventRecord, tmp_path: Path):
    write_events(frames(waveform, "c37.118-P:60", 60.0), tmp_path / "pmu.csv")
    (tmp_path / "model.py").write_text(PLANT.program)
    out = tmp_path / "played"
    assert (
        main(["playback", str(tmp_path / "model.py"), str(tmp_path / "pmu.csv"), "--out", str(out)])
        == 0
    )
    assert (out / "playback.json").exists()
