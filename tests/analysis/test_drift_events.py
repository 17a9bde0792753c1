"""What changed since, asked of records of events: truth comes from an independent simulation of the
same device.
"""

import json
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from ibrid_bench.events.device import Device, simulate

import ibrid
from ibrid.analysis.new_data.drift import drift
from ibrid.cli import main
from ibrid.evaluation.record import Record
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.recording import event_of

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
MILD, DEEP = ("dip:0.8,at=0.04,for=0.09", "phase:6,at=0.04"), ("dip:0.5,at=0.04,for=0.06",)


def recorded(seed: int, events=MILD, limits=None, **factors: float) -> Events:
    """The device with some values times a factor, at p = 0.8, q = 0.1, noise of 50 dB."""
    device = Device(
        {name: value * factors.get(name, 1.0) for name, value in NUMBERS.items()}, limits or {}
    )
    rng, time, found = np.random.default_rng(seed), np.arange(900) / 5000, []
    for event in events:
        shape = event_of(event).voltage(time, 1.0)
        v = np.stack([shape.real, shape.imag], axis=1)
        i = simulate(device, (0.8, 0.1, 1.0), time, v)
        sigma = 10**-2.5 * float(np.sqrt(np.mean((i - i[0]) ** 2)))
        rest = OperatingPoint(event.split(",")[0], float(i[0, 0]), float(-i[0, 1]), 1.0)
        found.append(EventRecord(rest, time, v, i + sigma * rng.standard_normal(i.shape), 0.0398))
    return Events(tuple(found))


@pytest.fixture(scope="module")
def record() -> Record:
    """Fitted to the benchmark's sweep at 50 dB."""
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    return ibrid.evaluate(
        ibrid.textbook("gfl_pll_filter_exact"),
        ibrid.add_noise(sweep, 50, rng=np.random.default_rng(1)),
    )


@pytest.mark.slow
def test_the_same_device_in_another_event_is_the_same(record: Record):
    assert [drift(record, recorded(seed)).verdict for seed in range(2)] == ["same"] * 2


@pytest.mark.nightly
def test_a_gain_that_changed_is_named_by_records_of_events(record: Record, tmp_path: Path, capsys):
    record.write(tmp_path / "fit.json")
    write_events(recorded(3, kI_pll=0.5), tmp_path / "events.csv")
    assert main(["drift", str(tmp_path / "fit.json"), str(tmp_path / "events.csv"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (change,) = found["changed"]
    assert (found["verdict"], change["parameter"]) == ("parameters", "pll.kI_pll")
    assert change["after"] / change["before"] == pytest.approx(0.5, rel=0.03)  # 50 dB


@pytest.mark.nightly
def test_a_limit_that_changed_is_named_and_one_that_did_not_is_the_same(record: Record):
    """The record has the limit as a joint fit with records leaves it."""
    told = {"id": "current_limit", "mode": "magnitude", "windup": False}
    large = [{**told, "parameters": {"i_max": 1.1}, "deviations": {"i_max": 1e-3}}]
    limited = replace(record, settings={**record.settings, "large_signal": large})
    own = {"mode": "magnitude", "windup": False}
    assert (
        drift(limited, recorded(5, DEEP, {"current_limit": {"i_max": 1.1, **own}})).verdict
        == "same"
    )
    found = drift(limited, recorded(5, DEEP, {"current_limit": {"i_max": 0.99, **own}}))
    assert [one.parameter for one in found.changed] == ["current_limit.i_max"]
    assert found.changed[0].after == pytest.approx(0.99, rel=0.01)
