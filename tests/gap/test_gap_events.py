"""A gap on records of events: a limit is named with its value, what was not reached is said, the
next fault is predicted.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from ibrid_bench.events.device import Device, simulate

from ibrid.cli import main
from ibrid.gap import progress
from ibrid.gap.results import files
from ibrid.gap.results.files import gap_json
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.recording import event_of
from ibrid.schemas import breach
from ibrid.writing import write_json

NUMBERS = {
    "L_F": 0.15,
    "R_F": 0.005,
    "C_F": 0.066,
    "L_g": 0.15,
    "R_g": 0.01,
    "kP_pll": 60.0,
    "kI_pll": 1400.0,
    "w_pll": 3000.0,
    "kP": 0.02,
    "kI": 20.0,
    "kP_c": 0.5,
    "kI_c": 15.0,
    "feedforward": 1.0,
    "decoupling": 0.15,
}
VALUES = {
    "plant.L_F": 0.155,
    "plant.R_F": 0.005,
    "plant.C_F": 0.064,
    "plant.L_g": 0.15,
    "plant.R_g": 0.01,
    "pll.kP_pll": 62.0,
    "pll.kI_pll": 1350.0,
    "pll_filter.omega_c": 3000.0,
    "power.kP": 0.02,
    "power.kI": 21.0,
    "current.kP": 0.5,
    "current.kI": 15.0,
    "decoupling.L": 0.15,
}


def record(name: str, event: str, limits: dict, rng: np.random.Generator) -> EventRecord:
    """Of an independent device at p = 0.8, q = 0.1, with noise of 50 dB."""
    time = np.arange(900) / 5000
    shape = event_of(event).voltage(time, 1.0)
    v = np.stack([shape.real, shape.imag], axis=1)
    i = simulate(Device(NUMBERS, limits), (0.8, 0.1, 1.0), time, v)
    rest = OperatingPoint(name, float(i[0, 0]), float(-i[0, 1]), 1.0)
    noise = 10**-2.5 * float(np.sqrt(np.mean((i - i[0]) ** 2)))
    return EventRecord(rest, time, v, i + noise * rng.standard_normal(i.shape), 0.0398)


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """The answer of the command on a record that reaches a current limit, and the folder with all
    files.
    """
    folder, rng = tmp_path_factory.mktemp("gap"), np.random.default_rng(0)
    limits = {"current_limit": {"i_max": 1.0, "mode": "magnitude", "windup": False}}
    write_events(
        Events((record("dip", "dip:0.45,at=0.04,for=0.09", limits, rng),)), folder / "dip.csv"
    )
    write_events(
        Events((record("next", "dip:0.6,at=0.04,for=0.09", limits, rng),)), folder / "next.csv"
    )
    (folder / "values.json").write_text(json.dumps(VALUES))
    words = [
        "gap",
        "gfl_pll_filter_exact",
        str(folder / "dip.csv"),
        "--values",
        str(folder / "values.json"),
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress, "EVERY", 0.0)
        patch.setattr(
            files,
            "write_partial",
            lambda gap, folder: write_json(Path(folder).parent / "so_far.json", gap_json(gap)),
        )
        assert main([*words, "--out", str(folder / "out")]) == 0
    return json.loads((folder / "out" / "gap.json").read_text()), folder


@pytest.mark.nightly
def test_a_limit_that_a_record_reaches_is_named_with_its_value(answered):
    gap, _ = answered
    assert gap["verdict"] == "named"
    assert [one["id"] for one in gap["effects"]] == ["current_limit"]
    estimate, low, high = gap["effects"][0]["parameters"]["current_limit.i_max"]
    assert (
        low < 1.0 < high or abs(estimate - 1.0) < 1e-3
    )  # the truth; 50 dB of noise over 900 samples
    assert gap["after"]["refit"] < 2 * gap["noise_floor"] < gap["before"]["refit"]


@pytest.mark.nightly
def test_a_scale_of_filter_and_controller_that_the_record_hardly_sees_stays_where_it_was_believed(
    answered,
):
    _, folder = answered
    fitted = next(
        iter(json.loads((folder / "out" / "model.json").read_text())["parameters"].values())
    )
    scale = {
        name: fitted[name] / VALUES[name] for name in ("plant.L_F", "current.kP", "decoupling.L")
    }
    assert scale == pytest.approx(dict.fromkeys(scale, 1.0), rel=0.2)


@pytest.mark.nightly
def test_what_is_known_on_the_way_is_passed_on(answered):
    gap, folder = answered
    on_the_way = json.loads((folder / "so_far.json").read_text())
    assert on_the_way["sentence"].startswith("So far: ")
    assert (on_the_way["complete"], gap["complete"]) == (False, True)
    assert breach(on_the_way, "gap") is None


@pytest.mark.nightly
def test_the_misfit_lies_where_the_limit_acts(answered):
    gap, _ = answered
    worst = gap["located"][0]
    assert worst["record"] == "dip"
    assert worst["component"] == "d"
    assert worst["window"][0] >= 0.039
    assert breach(gap, "gap") is None


@pytest.mark.nightly
def test_a_limit_is_listed_as_unseen_just_where_the_device_with_it_would_have_answered_the_same(
    answered,
):
    gap, _ = answered
    time = np.arange(900) / 5000
    shape = event_of("dip:0.45,at=0.04,for=0.09").voltage(time, 1.0)
    v = np.stack([shape.real, shape.imag], axis=1)
    limits = {"current_limit": {"i_max": 1.0, "mode": "magnitude", "windup": False}}
    both = limits | {"command_limit": {"u_max": 1.2, "windup": False}}  # the typical value
    one, other = (
        simulate(Device(NUMBERS, each), (0.8, 0.1, 1.0), time, v) for each in (limits, both)
    )
    seen = np.linalg.norm(one - other) > 10**-2.5 * np.linalg.norm(one - one[0])
    assert ("command_limit" in {each["id"] for each in gap["could_not_have_seen"]}) != seen


@pytest.mark.nightly
def test_the_repaired_model_predicts_the_next_fault(answered):
    _, folder = answered
    measured, out = read_events(folder / "next.csv"), folder / "answer.csv"
    words = [
        "predict",
        str(folder / "out" / "model.json"),
        "--events",
        str(folder / "next.csv"),
        "--out",
        str(out),
    ]
    assert main(words) == 0
    (before,), (after,) = measured.records, read_events(out).records
    error = np.linalg.norm(after.i - before.i) / np.linalg.norm(before.i - before.i_rest)
    assert error < 3 * 10**-2.5 * np.sqrt(2)  # three noise floors
    assert "dip" in (folder / "out" / "report.html").read_text()
