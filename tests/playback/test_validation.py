"""Error measures of IEC 61400-27-2: windows, filter and limits against closed forms."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibrid.cli import main
from ibrid.evaluation.record import read_record
from ibrid.measurement.estimators.window import window_of
from ibrid.measurement.recordings.events import EventRecord
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.compare import EventModel, Playback, PlayedRecord
from ibrid.playback.validation import LIMITS, _low_passed, validation, windows_of_standard
from ibrid.structure.diagrams.diagram import Diagram

F0 = 50.0
TIME = np.arange(0.0, 3.0, 2e-4)


def record(cleared: float | None = 1.35) -> EventRecord:
    """A dip to 0.5 from 1.2 s on, the current that of p = 0.8 at rest."""
    away = (TIME > 1.2) & ((9.0 if cleared is None else cleared) > TIME)
    v = np.stack([np.where(away, 0.5, 1.0), 0 * TIME], axis=1)
    i = np.stack([np.where(away, 1.1, 0.8), 0 * TIME], axis=1)
    return EventRecord(OperatingPoint("dip", 0.8, 0.0, 1.0), TIME, v, i, 1.2, f0_hz=F0)


def answered(one: EventRecord, error: complex) -> Playback:
    """A model whose current is off by an error all along."""
    current = one.i + np.array([error.real, error.imag])
    return Playback(EventModel(Diagram(), {}), (PlayedRecord(one, current, None, 0.1, {}, {}),))


def windows(playback: Playback) -> dict:
    return {window["name"]: window for window in validation(playback)["windows"]}


def test_windows_leave_out_what_the_standard_does():
    assert windows_of_standard(record(), F0) == {
        "before": pytest.approx((0.15, 1.15), abs=1e-3),
        "during": pytest.approx((1.22, 1.33), abs=1e-3),
        "after": pytest.approx((1.41, TIME[-1] - 0.02), abs=1e-3),
    }
    assert list(windows_of_standard(record(None), F0)) == ["before", "after"]


def test_an_error_of_the_current_is_that_of_ip_and_times_the_voltage_that_of_p():
    found = windows(answered(record(), 0.04 - 0.01j))
    for name, voltage in (("before", 1.0), ("during", 0.5), ("after", 1.0)):
        signals = found[name]["signals"]
        for signal, size in (
            ("ip", 0.04),
            ("iq", 0.01),
            ("p", 0.04 * voltage),
            ("q", 0.01 * voltage),
        ):
            for measure in ("mxe", "me", "mae"):
                assert signals[signal][measure] == pytest.approx(
                    size, abs=2e-3 if name == "during" else 1e-6
                )
                assert signals[signal]["unfiltered"][measure] == pytest.approx(size, abs=2e-3)


def test_limits_are_those_of_a_simulation_where_nothing_is_noisy_and_of_the_field_else():
    still = windows(answered(record(), 0.035 + 0j))["after"]
    assert still["reference"] == "simulated"
    assert still["signals"]["ip"]["limit"] == {"mxe": 0.05, "me": 0.02, "mae": 0.03}
    assert (still["signals"]["ip"]["pass"], still["signals"]["iq"]["pass"]) == (False, True)
    noisy = windows(answered(replace(record(), sigma=np.full(len(TIME), 1e-3)), 0.035 + 0j))[
        "after"
    ]
    assert noisy["reference"] == "field"
    assert noisy["signals"]["ip"]["pass"] is True
    assert set(LIMITS) == {"simulated", "field"}


def test_the_filter_passes_a_quarter_at_its_corner_and_delays_nothing():
    time = np.arange(4000) * 1e-3
    for hertz, part in ((15.0, 0.25), (6.5, 0.709), (1.0, 1.0 / (1.0 + 1.0 / 225.0) ** 2)):
        wave = np.sin(2.0 * np.pi * hertz * time)
        np.testing.assert_allclose(_low_passed(wave)[500:-500], part * wave[500:-500], atol=2e-3)


def test_frames_are_compared_from_the_jumps_that_their_window_hides():
    one = record()
    window = window_of("c37.118-P:100", F0)
    tags = np.arange(0.0, 2.9, 0.01)
    shows = window.matrix(tags, TIME)
    frames = EventRecord(
        one.rest, tags, shows @ one.v, shows @ one.i, 1.17, f0_hz=F0, window=window
    )
    assert windows_of_standard(frames, F0)["during"] == pytest.approx((1.22, 1.33), abs=2e-3)
    found = windows(answered(frames, 0.01 + 0j))
    assert all(signal["pass"] for window in found.values() for signal in window["signals"].values())


def test_frames_are_compared_up_to_the_last_whose_window_lies_in_the_record():
    one = record()
    window = window_of("c37.118-M:25", F0)
    tags = np.arange(0.0, 2.9, 0.04)
    shows = window.matrix(tags, TIME)
    frames = EventRecord(one.rest, tags, shows @ one.v, shows @ one.i, 1.0, f0_hz=F0, window=window)
    known = tags[~frames.masked][-1]
    assert known < tags[-1] - 0.05
    assert windows_of_standard(frames, F0)["after"][1] == pytest.approx(known - 0.02)
    last = frames.i.copy()
    last[frames.masked] += 5.0
    unseen = Playback(EventModel(Diagram(), {}), (PlayedRecord(frames, last, None, 0.1, {}, {}),))
    assert windows(unseen)["after"]["signals"]["ip"]["mxe"] == pytest.approx(0.0, abs=1e-9)


def test_playback_writes_the_table_of_the_standard(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    dip = tmp_path / "dip.csv"
    assert (
        main(
            [
                "record",
                "gfl_l_filter",
                "--op",
                "p=0.8,q=0.1",
                "--event",
                "dip:0.7",
                "--out",
                str(dip),
            ]
        )
        == 0
    )
    played = ["playback", "gfl_l_filter", str(dip), "--out", str(tmp_path / "a")]
    assert main([*played, "--standard", "iec"]) == 0
    assert "IEC 61400-27-2" in capsys.readouterr().out
    written = json.loads((tmp_path / "a" / "playback.json").read_text())["validation"]
    assert written["standard"] == "iec-61400-27-2"
    assert {window["name"] for window in written["windows"]} == {"before", "during", "after"}
    assert "IEC 61400-27-2" in (tmp_path / "a" / "report.html").read_text()
    assert main([*played, "--overwrite"]) == 0
    assert "validation" not in json.loads((tmp_path / "a" / "playback.json").read_text())


def test_a_fit_keeps_the_measures_in_its_record(tmp_path: Path):
    dip, fit = tmp_path / "dip.csv", tmp_path / "fit.json"
    assert (
        main(
            [
                "record",
                "gfl_l_filter",
                "--op",
                "p=0.8,q=0.1",
                "--event",
                "dip:0.9",
                "--out",
                str(dip),
            ]
        )
        == 0
    )
    asked = ["evaluate", "gfl_l_filter", str(dip), "--restarts", "0", "--json", str(fit)]
    assert main([*asked, "--standard", "iec", "--report", str(tmp_path / "fit.html")]) == 0
    written = json.loads(fit.read_text())["validation"]
    assert written["standard"] == "iec-61400-27-2"
    assert read_record(fit).validation["windows"] == written["windows"]
    assert "Error measures of IEC 61400-27-2" in (tmp_path / "fit.html").read_text()


def test_a_standard_without_records_is_refused(capsys: pytest.CaptureFixture[str]):
    assert main(["evaluate", "gfl", "paper_like", "--standard", "iec"]) == 2
    assert "--standard is for records of events" in capsys.readouterr().err
