"""Events files: what is written in phases or dq, in any convention, is read as per unit, current out, v at rest [v, 0]."""

from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement.event_csv import COLUMNS, read_event_csv, write_events
from ibrid.measurement.events import EventRecord

F0, BEGIN, END = 50.0, 0.1, 0.2
V_BASE, S_BASE = 400.0, 10e3
PEAK_V, PEAK_I = V_BASE * np.sqrt(2 / 3), S_BASE / V_BASE * np.sqrt(2 / 3)


def dip(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Voltage and current as d + j q, turned by 40 degrees: 1.02 to 0.6 and back, a current of 0.9 at 20 degrees."""
    during = (time > BEGIN) & (time < END)
    turn = np.exp(1j * np.deg2rad(40))
    return np.where(during, 0.6, 1.02) * turn, np.where(time > BEGIN, 1.2, 0.9) * np.exp(-1j * np.deg2rad(20)) * turn


def phases(value: np.ndarray, time: np.ndarray, turns: float = 1.0) -> np.ndarray:
    """(3, n) instantaneous values of a phasor that turns forwards, or backwards with turns=-1."""
    vector = value * np.exp(2j * np.pi * F0 * turns * time)
    return np.stack([(vector * np.exp(-2j * np.pi * k * turns / 3)).real for k in range(3)])


def write(path: Path, values: np.ndarray, time: np.ndarray, *keys: str, record: str = "dip") -> Path:
    columns = COLUMNS["abc" if len(values) == 6 else "dq"]
    lines = [f"# f0_hz: {F0}", *(f"# {key}" for key in keys), ",".join(("record", "t", *columns))]
    lines += [",".join([record, *map(repr, row)]) for row in np.column_stack([time, *values]).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


TIME = np.arange(0, 0.3, 2e-4)


def assert_is_the_dip(record: EventRecord, tolerance: float = 1e-12) -> None:
    v, i = dip(record.time)
    i = i / v * np.abs(v)  # in the frame of v, whose angle stays
    np.testing.assert_allclose(record.v[:, 0] + 1j * record.v[:, 1], np.abs(v), atol=tolerance)
    np.testing.assert_allclose(record.i[:, 0] + 1j * record.i[:, 1], i, atol=tolerance)
    power = 1.02 * 0.9 * np.exp(1j * np.deg2rad(20))
    assert record.name == "dip"
    rest = record.rest
    assert (rest.p, rest.q, rest.v) == pytest.approx((power.real, power.imag, 1.02), abs=tolerance)
    assert record.rest_end == pytest.approx(BEGIN, abs=1e-9)


def test_dq_at_any_angle_is_turned_to_the_voltage_at_rest(tmp_path: Path):
    v, i = dip(TIME)
    record = ibrid.read_events(write(tmp_path / "a.csv", np.stack([v.real, v.imag, i.real, i.imag]), TIME))["dip"]
    assert_is_the_dip(record)
    np.testing.assert_allclose(record.i[0], record.i_rest, atol=1e-12)


def test_balanced_phases_of_known_amplitude_and_angle_give_the_known_dq(tmp_path: Path):
    v, i = dip(TIME)
    values = np.concatenate([phases(v, TIME), phases(i, TIME)])
    record = ibrid.read_events(write(tmp_path / "a.csv", values, TIME))["dip"]
    assert_is_the_dip(record)
    assert record.negative == pytest.approx(0, abs=1e-12)
    assert record.zero == pytest.approx(0, abs=1e-12)


def test_si_units_are_peak_phase_values_on_the_base_of_line_to_line_rms(tmp_path: Path):
    v, i = dip(TIME)
    values = np.concatenate([phases(v, TIME) * PEAK_V, -phases(i, TIME) * PEAK_I])
    keys = ("unit: si", f"s_base_va: {S_BASE}", f"v_base_v: {V_BASE}", "current: in")
    assert_is_the_dip(ibrid.read_events(write(tmp_path / "a.csv", values, TIME, *keys))["dip"])


def test_a_lagging_q_axis_is_mirrored(tmp_path: Path):
    v, i = dip(TIME)
    values = np.stack([v.real, -v.imag, i.real, -i.imag])
    assert_is_the_dip(ibrid.read_events(write(tmp_path / "a.csv", values, TIME, "q_axis: lags"))["dip"])


def test_what_is_written_is_read_back_to_the_last_digit(tmp_path: Path):
    v, i = dip(TIME)
    rng = np.random.default_rng(1)
    values = np.stack([v.real, v.imag, i.real, i.imag]) + 0.01 * rng.normal(size=(4, len(TIME)))
    first = ibrid.read_events(write(tmp_path / "a.csv", values, TIME, "power_node: pcc"))
    write_events(first, tmp_path / "b.csv")
    again = ibrid.read_events(tmp_path / "b.csv")
    np.testing.assert_allclose(again["dip"].v, first["dip"].v, atol=1e-12)
    np.testing.assert_allclose(again["dip"].i, first["dip"].i, atol=1e-12)
    assert (again.f0_hz, again.power_node, again.names) == (F0, "pcc", ("dip",))


def test_phases_that_turn_the_wrong_way_are_refused(tmp_path: Path):
    v, i = dip(TIME)
    values = np.concatenate([phases(v, TIME)[[0, 2, 1]], phases(i, TIME)[[0, 2, 1]]])
    with pytest.raises(SweepError, match="the phases turn the wrong way"):
        read_event_csv(write(tmp_path / "a.csv", values, TIME))


def test_another_nominal_frequency_is_named(tmp_path: Path):
    v, i = dip(TIME)
    values = np.concatenate([phases(v, TIME), phases(i, TIME)])
    with pytest.raises(SweepError, match=r"f0_hz = 60; found 50.00 Hz"):
        read_event_csv(write(tmp_path / "a.csv", values, TIME), f0_hz=60)


def test_a_record_without_rest_is_refused(tmp_path: Path):
    v, i = dip(TIME + BEGIN - 0.03)
    values = np.stack([v.real, v.imag, i.real, i.imag])
    with pytest.raises(SweepError, match="must begin at rest for two cycles"):
        read_event_csv(write(tmp_path / "a.csv", values, TIME))
