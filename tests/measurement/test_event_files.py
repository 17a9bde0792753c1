"""Events files: what is written in phases or dq, in any convention, is read as per unit, current
out, v at rest [v, 0].
"""

from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement.formats.event_csv import COLUMNS, write_events
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import is_events_file
from ibrid.measurement.recordings.events import EventRecord
from ibrid.measurement.sweeps.sweep import OperatingPoint

F0, BEGIN, END = 50.0, 0.1, 0.2
V_BASE, S_BASE = 400.0, 10e3
PEAK_V, PEAK_I = V_BASE * np.sqrt(2 / 3), S_BASE / V_BASE * np.sqrt(2 / 3)


def dip(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Voltage and current as d + j q, turned by 40 degrees: 1.02 to 0.6 and back, a current of 0.9
    at 20 degrees.
    """
    during = (time > BEGIN) & (time < END)
    turn = np.exp(1j * np.deg2rad(40))
    return np.where(during, 0.6, 1.02) * turn, np.where(time > BEGIN, 1.2, 0.9) * np.exp(
        -1j * np.deg2rad(20)
    ) * turn


def phases(value: np.ndarray, time: np.ndarray, turns: float = 1.0) -> np.ndarray:
    """(3, n) instantaneous values of a vector that turns forwards, or backwards with turns=-1."""
    vector = value * np.exp(2j * np.pi * F0 * turns * time)
    return np.stack([(vector * np.exp(-2j * np.pi * k / 3)).real for k in range(3)])


def write(
    path: Path, values: np.ndarray, time: np.ndarray, *keys: str, record: str = "dip"
) -> Path:
    columns = COLUMNS["abc" if len(values) == 6 else "dq"]
    lines = [f"# f0_hz: {F0}", *(f"# {key}" for key in keys), ",".join(("record", "t", *columns))]
    lines += [
        ",".join([record, *map(repr, row)]) for row in np.column_stack([time, *values]).tolist()
    ]
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
    record = ibrid.read_events(
        write(tmp_path / "a.csv", np.stack([v.real, v.imag, i.real, i.imag]), TIME)
    )["dip"]
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
    assert_is_the_dip(
        ibrid.read_events(write(tmp_path / "a.csv", values, TIME, "q_axis: lags"))["dip"]
    )


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
        ibrid.read_events(write(tmp_path / "a.csv", values, TIME))


def test_another_nominal_frequency_is_named(tmp_path: Path):
    v, i = dip(TIME)
    values = np.concatenate([phases(v, TIME), phases(i, TIME)])
    with pytest.raises(SweepError, match=r"f0_hz = 60; found 50.00 Hz"):
        ibrid.read_events(write(tmp_path / "a.csv", values, TIME), f0_hz=60)


def test_a_record_without_rest_is_refused(tmp_path: Path):
    v, i = dip(TIME + BEGIN - 0.03)
    values = np.stack([v.real, v.imag, i.real, i.imag])
    with pytest.raises(SweepError, match="must begin at rest for two cycles"):
        ibrid.read_events(write(tmp_path / "a.csv", values, TIME))


def test_a_negative_sequence_of_five_percent_is_reported_as_that(tmp_path: Path):
    v, i = dip(TIME)
    unbalanced = phases(v, TIME) + phases(0.05 * np.exp(1j) * np.ones(len(TIME)), TIME, turns=-1)
    values = np.concatenate([unbalanced + 0.02, phases(i, TIME)])
    record = ibrid.read_events(write(tmp_path / "a.csv", values, TIME))["dip"]
    assert record.negative == pytest.approx(0.05, abs=1e-12)
    assert record.zero == pytest.approx(0.02, abs=1e-12)
    assert record.rest.v == pytest.approx(1.02, abs=1e-12)


def test_another_frequency_before_the_event_is_turned_out_and_said(tmp_path: Path):
    v, i = dip(TIME)
    slip = np.exp(2j * np.pi * 0.03 * TIME)
    values = np.concatenate([phases(v * slip, TIME), phases(i * slip, TIME)])
    record = ibrid.read_events(write(tmp_path / "a.csv", values, TIME))["dip"]
    assert_is_the_dip(record, 1e-9)
    assert record.offset_hz == pytest.approx(0.03, abs=1e-9)
    assert "50.0300 Hz" in record.remarks[0]


def test_noise_alone_neither_ends_the_rest_nor_turns_the_frame(tmp_path: Path):
    rng = np.random.default_rng(2)
    v, i = dip(TIME)
    clean = np.stack([v.real, v.imag, i.real, i.imag])
    for _ in range(5):
        noisy = clean + 0.01 * rng.normal(size=clean.shape)
        record = ibrid.read_events(write(tmp_path / "a.csv", noisy, TIME))["dip"]
        assert record.rest_end == pytest.approx(BEGIN, abs=1e-9)
        assert record.offset_hz == 0
        assert record.rest.v == pytest.approx(1.02, abs=5 * 0.01 / np.sqrt(500))


def test_the_noise_of_phases_becomes_that_of_d_and_q(tmp_path: Path):
    """Of three equal independent phases (2/3)^2 (1 + 1/4 + 1/4) sigma^2 = 2/3 sigma^2 in each
    component.
    """
    v, i = dip(TIME)
    path = write(tmp_path / "a.csv", np.concatenate([phases(v, TIME), phases(i, TIME)]), TIME)
    head, names, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, f"{names},sigma", *(f"{row},0.03" for row in rows)]))
    np.testing.assert_allclose(ibrid.read_events(path)["dip"].sigma, 0.03 * np.sqrt(2 / 3))
    path.write_text("\n".join([head, f"{names},sigma", *(f"{row}," for row in rows)]))
    assert ibrid.read_events(path)["dip"].sigma is None


def test_several_records_at_uneven_times_keep_their_own_samples(tmp_path: Path):
    rng = np.random.default_rng(3)
    uneven = np.sort(rng.choice(TIME, 700, replace=False)) - 7.0
    first, second = (
        np.stack([v.real, v.imag, i.real, i.imag]) for v, i in (dip(TIME), dip(uneven + 7.0))
    )
    text = write(tmp_path / "a.csv", first, TIME).read_text()
    rows = (
        write(tmp_path / "b.csv", second, uneven, record='"late, uneven"')
        .read_text()
        .split("\n", 2)[2]
    )
    (tmp_path / "a.csv").write_text(text + rows)
    events = ibrid.read_events(tmp_path / "a.csv")
    assert events.names == ("dip", "late, uneven")
    np.testing.assert_array_equal(events["late, uneven"].time, uneven)
    assert events["late, uneven"].rest.v == pytest.approx(1.02)
    assert repr(events) == "<Events: 2 records (dip; late, uneven), 2200 samples>"
    with pytest.raises(ibrid.IbridError, match="did you mean dip"):
        events["dipp"]


def test_between_samples_the_voltage_is_the_cubic_spline_through_them(tmp_path: Path):
    """A cubic in time, which a spline with the usual ends follows exactly, begins after the rest
    with three zero derivatives.
    """
    v, i = dip(TIME)
    record = ibrid.read_events(
        write(tmp_path / "a.csv", np.stack([v.real, v.imag, i.real, i.imag]), TIME)
    )["dip"]
    np.testing.assert_allclose(record.voltage(record.time), record.v, atol=1e-12)
    smooth = EventRecord(
        record.rest,
        record.time,
        np.stack([1 + record.time**3, 0 * record.time], -1),
        record.i,
        BEGIN,
    )
    middle = (record.time[1:] + record.time[:-1]) / 2
    np.testing.assert_allclose(smooth.voltage(middle)[:, 0], 1 + middle**3, atol=1e-12)


def test_hundreds_of_kilohertz_are_low_passed_and_thinned(tmp_path: Path):
    """200 kHz to 25 kHz: 2 kHz passes to the edges' 1e-3, 40 kHz, which would fold to 10 kHz, is
    gone to -60 dB.
    """
    time = np.arange(0, 0.1, 5e-6)
    ripple = 0.1 * np.exp(2j * np.pi * 2e3 * time) + 0.1 * np.exp(2j * np.pi * 40e3 * time)
    i = 0.5 + np.where(time > 0.05, ripple, 0)
    values = np.stack([np.ones(len(time)), 0 * time, i.real, i.imag])
    record = ibrid.read_events(write(tmp_path / "a.csv", values, time))["dip"]
    assert np.median(np.diff(record.time)) == pytest.approx(4e-5)
    assert "resampled to 25 kHz" in record.remarks[0]
    inside = (record.time > 0.055) & (record.time < 0.095)
    current = record.i[:, 0] + 1j * record.i[:, 1]
    left = current - 0.5 - 0.1 * np.exp(2j * np.pi * 2e3 * record.time)
    assert np.abs(left[inside]).max() < 5e-4


@pytest.mark.slow
def test_tables_and_frames_hold_records_too(tmp_path: Path):
    pandas = pytest.importorskip("pandas", reason="frames are made by pandas (pip install pandas)")
    v, i = dip(TIME)
    values = np.concatenate([phases(v, TIME), phases(i, TIME)])
    frame = pandas.DataFrame({"time": TIME, **dict(zip(COLUMNS["abc"], values, strict=True))})
    record = ibrid.read_events(frame, f0_hz=F0)
    assert record.names == ("op",)
    assert record["op"].rest.v == pytest.approx(1.02)
    odd = frame.rename(columns={"time": "Zeit", "v_a": "x", "i_c": "y"})
    with pytest.raises(SweepError, match="must have one channel for va"):
        ibrid.read_events(odd, f0_hz=F0)
    told = ibrid.read_events(odd, f0_hz=F0, channels="t=Zeit,va=x,ic=y")
    np.testing.assert_allclose(told["op"].v, record["op"].v)
    text = tmp_path / "recorder.txt"
    text.write_text(odd.to_csv(sep=";", decimal=",", index=False))
    same = ibrid.read_events(text, f0_hz=F0, channels={"t": "Zeit", "va": 2, "ic": 7})
    np.testing.assert_allclose(same["recorder"].i, record["op"].i, atol=1e-12)
    events = ibrid.read_events(write(tmp_path / "a.csv", values, TIME, "power_node: pcc"))
    again = ibrid.read_events(events.to_dataframe())
    assert (again.f0_hz, again.power_node) == (F0, "pcc")
    np.testing.assert_allclose(again["dip"].i, events["dip"].i, atol=1e-12)


@pytest.mark.slow
def test_a_workbook_holds_a_record(tmp_path: Path):
    openpyxl = pytest.importorskip(
        "openpyxl", reason="workbooks are written by openpyxl (pip install openpyxl)"
    )
    v, i = dip(TIME)
    book = openpyxl.Workbook()
    book.active.append(["t", *COLUMNS["dq"]])
    for row in np.column_stack([TIME, v.real, v.imag, i.real, i.imag]).tolist():
        book.active.append(row)
    book.create_sheet("empty")
    hidden = book.create_sheet("earlier")
    hidden.append(["t", *COLUMNS["dq"]])
    hidden.append([0.0, 9.0, 9.0, 9.0, 9.0])
    hidden.sheet_state = "hidden"
    book.save(tmp_path / "dip.xlsx")
    events = ibrid.read_events(tmp_path / "dip.xlsx", f0_hz=F0)
    assert_is_the_dip(events["dip"])
    assert "sheet earlier is hidden: left out" in events.notes
    book.active.cell(200_000, 1, "x")
    book.save(tmp_path / "far.xlsx")
    with pytest.raises(
        SweepError, match=f"ends in row {len(TIME) + 1}, but row 200000 holds a cell"
    ):
        ibrid.read_events(tmp_path / "far.xlsx", f0_hz=F0)


LOOKS = {
    "semicolons": lambda text: text.replace(",", ";"),
    "tabs": lambda text: text.replace(",", "\t"),
    "decimal commas": lambda text: text.replace(",", ";").replace(".", ","),
    "capitals": lambda text: text.replace("record,t,v_a", "RECORD,T,V_A"),
    "time": lambda text: text.replace("record,t,", "record,time,"),
    "no underscores": lambda text: text.replace("v_", "v").replace("i_", "i"),
}


@pytest.mark.slow
@pytest.mark.parametrize("look", LOOKS)
def test_what_a_file_says_of_itself_holds_however_its_table_looks(tmp_path: Path, look: str):
    v, i = dip(TIME)
    values = np.concatenate([PEAK_V * phases(v, TIME), -PEAK_I * phases(i, TIME)])
    keys = (
        "unit: si",
        f"s_base_va: {S_BASE}",
        f"v_base_v: {V_BASE}",
        "current: in",
        "power_node: pcc",
    )
    path = write(tmp_path / "a.csv", values, TIME, *keys)
    head, table = path.read_text().split("\nrecord", 1)
    path.write_text(f"{head}\n{LOOKS[look]('record' + table)}")
    assert is_events_file(path)
    events = ibrid.read_events(path)
    assert (events.f0_hz, events.power_node, events.v_base_v) == (F0, "pcc", V_BASE)
    assert_is_the_dip(events["dip"])
    assert ibrid.read_events(path, current="out")["dip"].rest.p < 0


def test_keys_hold_where_channels_are_told(tmp_path: Path):
    v, i = dip(TIME)
    path = write(
        tmp_path / "a.csv", np.stack([v.real, v.imag, -i.real, -i.imag]), TIME, "current: in"
    )
    assert_is_the_dip(ibrid.read_events(path, channels="t=t,vd=v_d,vq=v_q,id=i_d,iq=i_q")["dip"])


def test_a_base_implies_si_where_a_table_says_nothing_of_itself(tmp_path: Path):
    pandas = pytest.importorskip("pandas", reason="frames are made by pandas (pip install pandas)")
    v, i = dip(TIME)
    values = np.concatenate([PEAK_V * phases(v, TIME), PEAK_I * phases(i, TIME)])
    frame = pandas.DataFrame({"t": TIME, **dict(zip(COLUMNS["abc"], values, strict=True))})
    assert ibrid.read_events(frame, f0_hz=F0, base="10kVA,400V")["op"].rest.v == pytest.approx(1.02)
    with pytest.raises(SweepError, match=r"found 333\.1, the columns are probably in V and A"):
        ibrid.read_events(frame, f0_hz=F0, base="10kVA,400V", unit="pu")
    ours = ibrid.read_events(
        write(tmp_path / "a.csv", np.stack([v.real, v.imag, i.real, i.imag]), TIME)
    ).to_dataframe()
    assert_is_the_dip(ibrid.read_events(ours, base="10kVA,400V")["dip"])


def test_a_folder_in_place_of_records_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SweepError, match="must be a file; found a folder"):
        ibrid.read_events(".")


BAD = {
    "nothing": (lambda lines: [], "must hold a sweep or records of events; found an empty file"),
    "no rows": (lambda lines: lines[:2], "must hold rows of numbers"),
    "a column missing": (
        lambda lines: [one.replace("v_q", "vq") for one in lines],
        "column v_q is missing.*found 'vq'",
    ),
    "a column twice": (
        lambda lines: [one.replace("v_q", "v_d") for one in lines],
        "must be there once",
    ),
    "an unknown column": (
        lambda lines: [lines[0], lines[1] + ",sigm", *(one + ",1" for one in lines[2:])],
        "column 'sigm' is not known, did you mean sigma",
    ),
    "an unknown unit": (
        lambda lines: ["# unit: volts", *lines],
        "line 1: unit must be pu or si; found volts",
    ),
    "a key as an option": (
        lambda lines: ["# f0-hz: 50", *lines],
        "f0-hz is not a key, it is written f0_hz",
    ),
    "a key with a blank": (lambda lines: ["# Power node: pcc", *lines], "it is written power_node"),
    "a mistyped key": (lambda lines: ["# f0: 50", *lines], "f0 is not a key, did you mean"),
    "a key of others": (lambda lines: ["# nominal_frequency: 50", *lines], "did you mean f0_hz"),
    "another key of others": (lambda lines: ["# direction: in", *lines], "did you mean current"),
    "no base": (lambda lines: ["# unit: si", "# v_base_v: 400", *lines], "s_base_va is missing"),
    "text": (
        lambda lines: [*lines[:40], lines[40].replace(",", ",x", 1), *lines[41:]],
        "line 41: t must be a finite number",
    ),
    "not a number": (
        lambda lines: [*lines[:-1], "dip,0.4,1,0,nan,0"],
        "i_d must be a finite number; found nan",
    ),
    "a cut line": (
        lambda lines: [*lines[:-1], lines[-1][:9]],
        "must have 6 values, one per column",
    ),
    "time that stands": (
        lambda lines: [*lines[:50], lines[49], *lines[50:]],
        "line 51: the time of record dip must increase",
    ),
    "a short record": (lambda lines: lines[:100], "must be longer than the two cycles at rest"),
    "few samples": (
        lambda lines: [*lines[:2], lines[2], *lines[900:]],
        "must have samples within the first two cycles",
    ),
    "no voltage": (
        lambda lines: [*lines[:2], *("dip," + one.split(",")[1] + ",0,0,0,0" for one in lines[2:])],
        "a voltage",
    ),
    "a negative sigma": (
        lambda lines: [lines[0], lines[1] + ",sigma", *(one + ",-1" for one in lines[2:])],
        "sigma of record dip must be positive",
    ),
}


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_file_is_one_sentence_that_says_where(tmp_path: Path, bad: str):
    v, i = dip(TIME)
    lines = (
        write(tmp_path / "a.csv", np.stack([v.real, v.imag, i.real, i.imag]), TIME)
        .read_text()
        .splitlines()
    )
    change, sentence = BAD[bad]
    (tmp_path / "a.csv").write_text("\n".join(change(lines)))
    with pytest.raises(SweepError, match=sentence) as refused:
        ibrid.read_events(tmp_path / "a.csv")
    assert "\n" not in str(refused.value)


def test_unknown_words_about_events_name_the_near_ones(tmp_path: Path):
    with pytest.raises(
        SweepError, match="unitt is not something to say about events; did you mean unit"
    ):
        ibrid.read_events(tmp_path / "a.csv", unitt="si")
    with pytest.raises(SweepError, match="read_events takes a path or a DataFrame; found int"):
        ibrid.read_events(3)


def test_records_draw_themselves(tmp_path: Path):
    v, i = dip(TIME)
    events = ibrid.read_events(
        write(tmp_path / "a.csv", np.stack([v.real, v.imag, i.real, i.imag]), TIME)
    )
    voltage, current = events.plot().axes
    assert [len(axes.lines) for axes in (voltage, current)] == [2, 2]
    np.testing.assert_array_equal(current.lines[1].get_ydata(), events["dip"].i[:, 1])
    with pytest.raises(ibrid.IbridError, match="ax must be two axes"):
        events.plot(ax=voltage)


def test_prose_behind_a_word_that_others_use_as_a_key_is_a_note(tmp_path):
    shipped = Path(ibrid.benchmarks()["paper_like"]).read_text()
    (tmp_path / "sweep.csv").write_text(f"# frequency: 1 Hz to 1 kHz, by hand\n{shipped}")
    assert "frequency: 1 Hz to 1 kHz, by hand" in read_sweep(tmp_path / "sweep.csv").notes


def test_what_a_record_was_told_cannot_be_changed():
    time, still = np.linspace(0.0, 1.0, 5), np.zeros((5, 2))
    rest = OperatingPoint("a", 0.5, 0.1)
    record = EventRecord(rest, time, still + 1.0, still, 0.1, told={"p_ref": np.ones(5)})
    with pytest.raises(TypeError, match="frozen"):
        record.told["p_ref"] = np.zeros(5)  # type: ignore[index]
