"""Events files of phasors and rms values: read as per unit, current out, v at rest [v, 0]; each
mistake is one sentence.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid.cli import main
from ibrid.errors import SweepError
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.read_events import is_events_file
from ibrid.measurement.recordings.events import EventRecord

F0, RATE = 50.0, 50.0
V_BASE, S_BASE = 20e3, 10e6
PHASE, CURRENT = V_BASE / np.sqrt(3), S_BASE / (np.sqrt(3) * V_BASE)
TIME = np.arange(100) / RATE
V = np.where((TIME > 0.9) & (TIME < 1.2), 0.6, 1.02) + 0j
I = np.where(TIME > 0.9, 1.1, 0.8) * np.exp(-0.3j)
PHASORS = {
    "v_mag": np.abs(V),
    "v_deg": 0 * TIME + 40.0,
    "i_mag": np.abs(I),
    "i_deg": np.rad2deg(np.angle(I)) + 40.0,
}
POWERS = {"u": np.abs(V), "p": np.real(V * np.conj(I)), "q": np.imag(V * np.conj(I))}
CURRENTS = {"u": np.abs(V), "i_p": np.real(I), "i_q": -np.imag(I)}


def write(
    path: Path, columns: dict, *keys: str, time: np.ndarray = TIME, window: str = "none"
) -> Path:
    lines = [
        f"# f0_hz: {F0}",
        f"# window: {window}",
        *(f"# {key}" for key in keys),
        ",".join(("record", "t", *columns)),
    ]
    lines += [
        ",".join(["a", *map(repr, row)])
        for row in np.column_stack([time, *columns.values()]).tolist()
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def assert_is_the_dip(record: EventRecord) -> None:
    np.testing.assert_allclose(record.v @ [1, 1j], V, atol=1e-12)
    np.testing.assert_allclose(record.i @ [1, 1j], I, atol=1e-12)
    assert (record.rest.p, record.rest.q) == pytest.approx(
        (1.02 * 0.8 * np.cos(0.3), 1.02 * 0.8 * np.sin(0.3)), abs=1e-12
    )


SI = ("unit: si", f"s_base_va: {S_BASE}", f"v_base_v: {V_BASE}")
READ = {
    "phasors": (PHASORS, ()),
    "powers": (POWERS, ()),
    "currents, of which that of q has the sign of q": (CURRENTS, ()),
    "phasors of a phase in V and A": (
        PHASORS | {"v_mag": PHASE * np.abs(V), "i_mag": CURRENT * np.abs(I)},
        (*SI, "frame: phasor", "phase: a"),
    ),
    "phasors line to line": (
        PHASORS | {"v_mag": V_BASE * np.abs(V), "i_mag": CURRENT * np.abs(I)},
        (*SI, "v_is: line"),
    ),
    "powers in W and var": (
        {"u": PHASE * POWERS["u"], "p": S_BASE * POWERS["p"], "q": S_BASE * POWERS["q"]},
        SI,
    ),
    "powers in W, a voltage line to line": (
        {"u": V_BASE * POWERS["u"], "p": S_BASE * POWERS["p"], "q": S_BASE * POWERS["q"]},
        (*SI, "v_is: line"),
    ),
    "powers counted into the device": (
        {"u": POWERS["u"], "p": -POWERS["p"], "q": -POWERS["q"]},
        ("current: in",),
    ),
    "powers and currents that agree": (POWERS | CURRENTS, ()),
}


@pytest.mark.parametrize("form", READ)
def test_every_form_of_frames_is_read_as_the_same_record(tmp_path: Path, form: str):
    columns, keys = READ[form]
    path = write(tmp_path / "a.csv", columns, *keys)
    assert is_events_file(path)
    assert_is_the_dip(ibrid.read_events(path)["a"])


def test_a_recorded_angle_or_its_frequency_turns_the_voltage_of_rms_values(tmp_path: Path):
    angle = 0.4 * np.clip(TIME - 0.9, 0.0, 0.5)
    turned = write(tmp_path / "a.csv", POWERS | {"angle_deg": np.rad2deg(angle)})
    frequency = F0 + np.where((TIME > 0.9) & (TIME < 1.4), 0.4, 0.0) / (2 * np.pi)
    integrated = write(tmp_path / "b.csv", POWERS | {"f": frequency})
    for path, apart in (
        (turned, 1e-12),
        (integrated, 0.4 / RATE + 1e-9),
    ):  # half of a step at either end
        record = ibrid.read_events(path)["a"]
        np.testing.assert_allclose(np.unwrap(np.angle(record.v @ [1, 1j])), angle, atol=apart)
        np.testing.assert_allclose(record.i @ [1, 1j] / np.exp(1j * angle), I, atol=2 * apart)


def test_powers_without_an_angle_say_that_none_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["inspect", str(write(tmp_path / "a.csv", POWERS))]) == 0
    assert "no angle and no frequency were recorded" in capsys.readouterr().out


def test_what_is_written_is_read_back_with_its_window(tmp_path: Path):
    for window in ("none", "dft:1", "c37.118-P:50"):
        first = ibrid.read_events(write(tmp_path / "a.csv", PHASORS, window=window))
        write_events(first, tmp_path / "b.csv")
        second = ibrid.read_events(tmp_path / "b.csv")
        assert (second.window, second["a"].remarks) == (window, first["a"].remarks)
        np.testing.assert_allclose(second["a"].v, first["a"].v, atol=1e-12)
        assert second["a"].rest_end == first["a"].rest_end


def test_a_data_frame_keeps_the_window(tmp_path: Path):
    pytest.importorskip("pandas")
    first = ibrid.read_events(write(tmp_path / "a.csv", PHASORS, window="dft:1"))
    second = ibrid.read_events(first.to_dataframe())
    assert second.window == "dft:1"
    np.testing.assert_allclose(second["a"].v, first["a"].v, atol=1e-12)


def test_slow_frames_find_their_rest_with_five_of_them(tmp_path: Path):
    time = np.arange(100.0)
    record = ibrid.read_events(write(tmp_path / "a.csv", POWERS, time=time))["a"]
    assert record.rest_end == pytest.approx(time[TIME <= 0.9][-1])


def test_slow_frames_of_a_window_that_is_not_known_are_read(tmp_path: Path):
    record = ibrid.read_events(
        write(tmp_path / "a.csv", POWERS, time=10.0 * np.arange(100.0), window="unknown")
    )["a"]
    assert any(one.startswith("the estimator's window is not known") for one in record.remarks)


def test_a_set_point_of_a_voltage_line_to_line_is_per_unit_as_the_voltage_is(tmp_path: Path):
    columns = PHASORS | {
        "v_mag": V_BASE * np.abs(V),
        "i_mag": CURRENT * np.abs(I),
        "v_ref": 0 * TIME + 1.02 * V_BASE,
    }
    record = ibrid.read_events(write(tmp_path / "a.csv", columns, *SI, "v_is: line"))["a"]
    np.testing.assert_allclose(record.told["v_ref"], record.rest.v)


def test_records_of_different_windows_are_not_written_into_one_file(tmp_path: Path):
    first = ibrid.read_events(write(tmp_path / "a.csv", PHASORS, window="dft:1"))
    other = ibrid.read_events(write(tmp_path / "b.csv", PHASORS, window="none"))["a"]
    other = replace(other, rest=replace(other.rest, name="b"))
    with pytest.raises(
        SweepError, match="must have one window; found dft:1, none: write them one by one"
    ):
        write_events(replace(first, records=(*first.records, other)), tmp_path / "both.csv")


def without(columns: dict, name: str) -> dict:
    return {key: value for key, value in columns.items() if key != name}


LATER = np.where(np.arange(100) < 50, TIME, TIME - 3600.0) + 3600.0
TWICE = np.where(np.arange(100) == 40, TIME[39], TIME)
BAD: dict[str, tuple[Callable[[Path], Path], str]] = {
    "no angle": (
        lambda path: write(path, without(PHASORS, "v_deg")),
        "column v_deg is missing, the angle; without angles",
    ),
    "half of a pair": (
        lambda path: write(path, POWERS | {"i_p": CURRENTS["i_p"]}),
        "column i_q is missing; events have the columns record,t,u,p,q,i_p,i_q",
    ),
    "the other half of a pair": (
        lambda path: write(path, CURRENTS | {"p": POWERS["p"]}),
        "column q is missing",
    ),
    "another base": (
        lambda path: write(path, CURRENTS | {"p": 10 * POWERS["p"], "q": 10 * POWERS["q"]}),
        "found 10 times as much: they are of another base",
    ),
    "clocks put back": (
        lambda path: write(path, POWERS, time=LATER),
        "goes back by an hour, from 3600.98 to 1 s, as clocks do",
    ),
    "a time twice": (lambda path: write(path, POWERS, time=TWICE), "found 0.78 s twice"),
    "no frequency": (
        lambda path: write(path, POWERS | {"f": 0 * TIME}),
        "the frequency f must be within 15 Hz of f0_hz = 50",
    ),
    "too slow": (
        lambda path: write(
            path, {key: value[:5] for key, value in POWERS.items()}, time=np.arange(5.0)
        ),
        "must have 5 frames at rest and more behind them; found 5",
    ),
    "a window of waveforms": (
        lambda path: write(path, POWERS, "solver: trapezoidal"),
        "is of waveforms, not of frames",
    ),
    "no such window": (
        lambda path: write(path, POWERS, window="dft"),
        "is written dft:CYCLES, with a positive number",
    ),
    "a q axis that lags": (
        lambda path: write(path, PHASORS, "q_axis: lags"),
        "q_axis is of frame: dq",
    ),
    "a frame missing in the middle of a cell": (
        lambda path: write(path, POWERS | {"p": np.where(TIME[9] == TIME, np.nan, POWERS["p"])}),
        "p must be a finite number; found nan",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_frames_are_one_sentence(tmp_path: Path, case: str):
    make, words = BAD[case]
    with pytest.raises(SweepError, match=r"a\.csv") as reason:
        ibrid.read_events(make(tmp_path / "a.csv"))
    assert words in str(reason.value)
    assert str(reason.value).count("\n") == 0


def test_missing_frames_and_powers_of_the_system_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    kept = (np.arange(100) < 60) | (np.arange(100) > 63)
    write(tmp_path / "a.csv", {key: value[kept] for key, value in POWERS.items()}, time=TIME[kept])
    assert main(["inspect", str(tmp_path / "a.csv")]) == 0
    assert "about 4 frames missing in 1 gap, the longest of 0.1 s from 1.18 s" in " ".join(
        capsys.readouterr().out.split()
    )
    write(tmp_path / "b.csv", {"u": POWERS["u"], "p": 10 * POWERS["p"], "q": 10 * POWERS["q"]})
    assert main(["inspect", str(tmp_path / "b.csv")]) == 0
    assert "powers per unit of the system's base" in " ".join(capsys.readouterr().out.split())


def test_inspect_says_which_loops_frames_can_show_and_which_never(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["inspect", str(write(tmp_path / "a.csv", PHASORS, window="c37.118-P:50"))]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "window of the estimator c37.118-P:50, up to 16" in words
    assert "cannot tell: current loop (100 Hz to 1 kHz), ever" in words
    assert "a part of synchronisation (PLL) (5 Hz to 100 Hz)" in words
