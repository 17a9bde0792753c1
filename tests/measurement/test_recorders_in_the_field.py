"""Recordings as recorders of the field write them: probes, two wattmeters, clocks, phasors of
phasor measurement units, times that only a sampling rate tells.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import collecting
from recording_makes import (
    BASE,
    F0,
    I_PEAK,
    S_BASE,
    V_BASE,
    P,
    Q,
    current,
    six,
    text,
    times,
    voltage,
    written,
)

import ibrid
from ibrid import cli
from ibrid.measurement.importing.timed.probes import volts_per_ampere
from ibrid.measurement.importing.timed.sampled_times import sampling_told
from ibrid.measurement.importing.timed.signal_names import signal_of
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.recordings.events import EventRecord

BASES = {"base": "10MVA,20kV", "f0_hz": F0}
TURN = np.exp(-1j * np.deg2rad(13))
TIME, VALUES = six()
VA, VB, VC, IA, IB, IC = VALUES


def assert_is_the_law(record: EventRecord, digits: float = 1e-6) -> None:
    """p, q and v at rest, and every sample."""
    rest = np.subtract([record.rest.p, record.rest.q, record.rest.v], [P, Q, 1])
    assert np.abs(rest).max() < digits
    for name, law in (("v", voltage), ("i", current)):
        assert np.abs(getattr(record, name) @ [1, 1j] - law(record.time) * TURN).max() < digits


def imported(path: Path, *options: str) -> EventRecord:
    """The record that `ibrid import` makes of a file; its answer is that of success."""
    out = path.parent / "events.out.csv"
    assert cli.main(["import", str(path), *BASE, *options, "--out", str(out)]) == 0
    return ibrid.read_events(out).records[0]


def test_two_wattmeters_are_three_phases(tmp_path, capsys):
    """Voltages of phases 1 and 3 to phase 2, and the currents of both."""
    with collecting() as failures:
        for names, channels in (
            ("t (s)|U12 (V)|U32 (V)|I1 (A)|I3 (A)", ()),
            ("t (s)|A|B|C|D", ("--channels", "t=1,vab=2[V],vcb=3[V],ia=4[A],ic=5[A]")),
        ):
            with failures.case(names):
                columns = [TIME, VA - VB, VC - VB, IA, IC]
                (path,) = written(tmp_path, "two.csv", text(names.split("|"), columns))
                assert_is_the_law(imported(path, *channels))
                said = capsys.readouterr().err
                assert "for three wires: vbc [V], ib [A] from" in said
                assert "not used" not in said


def test_phasors_of_a_measurement_unit_are_those_of_the_positive_sequence(tmp_path):
    """VP_M, VP_A as phasor measurement units call them."""
    time = times(250)
    v, i = voltage(time), current(time)
    names = ["TIMESTAMP", "VP_M (V)", "VP_A (deg)", "IP_M (A)", "IP_A (deg)", "FREQ (Hz)"]
    sizes = [abs(v) * V_BASE / np.sqrt(3), abs(i) * I_PEAK / np.sqrt(2)]
    angles = [np.angle(one, deg=True) for one in (v, i)]
    columns = [sizes[0], angles[0], sizes[1], angles[1], np.full(len(time), F0)]
    stamps = np.datetime64("2026-03-01T11:59:59.9") + (time * 1e9).astype("timedelta64[ns]")
    rows = [
        ",".join([str(stamp).replace("T", " "), *(f"{cell:.12g}" for cell in row)])
        for stamp, row in zip(stamps, np.stack(columns, axis=1), strict=True)
    ]
    (path,) = written(tmp_path, "pmu.csv", "\n".join([",".join(names), *rows, ""]))
    options = ("--channels", "t=1,v_mag=2[V],v_ang=3[deg],i_mag=4[A],i_ang=5[deg],f=6")
    assert_is_the_law(imported(path))
    assert_is_the_law(imported(path, *options))


def rms_columns() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, voltage, p and q per unit, each ms."""
    time = times(1000)
    s = voltage(time) * np.conj(current(time))
    return time, abs(voltage(time)), s.real, s.imag


def test_voltage_per_unit_beside_powers_with_units_is_of_the_base(tmp_path, capsys):
    """The names of PowerFactory in two languages, and the other way about."""
    time, v, p, q = rms_columns()
    mega = S_BASE / 1e6
    german = "Zeitpunkt in s;Klemme: Spannung, Betrag in p.u.;WR: Wirkleistung in MW"
    english = '"b:tnow in s","Voltage, Magnitude in p.u.","Active Power in MW"'
    cases = {
        "german": (f"{german};WR: Blindleistung in Mvar", ";", [v, p * mega, q * mega]),
        "english": (f'{english},"Reactive Power in Mvar"', ",", [v, p * mega, q * mega]),
        "kV beside per unit": ("t [s],U [kV],p [pu],q [pu]", ",", [v * V_BASE / 1e3, p, q]),
    }
    with collecting() as failures:
        for name, (head, mark, columns) in cases.items():
            with failures.case(name):
                rows = text([], [time, *columns], mark, comma=mark == ";")
                (path,) = written(tmp_path, "rms.csv", f"{head}\n{rows}")
                assert_is_the_law(imported(path))
                assert "on the base of 10 MVA and 20 kV" in capsys.readouterr().err
                with pytest.raises(ibrid.IbridError, match='add base="S_VA,V_LL"'):
                    ibrid.read_events(path, f0_hz=F0)


def test_an_object_before_the_name_of_a_variable_is_left_out():
    read = {
        "Klemme: Spannung, Betrag in p.u.": "v_mag",
        "WR: Wirkleistung in MW": "p",
        "Trace 1: Va (V)": "va",
        "Bus 3: Strom L1 in kA": "ia",
        "Scope: 12:30": "",
        "m:phiu1 in deg": "v_ang",
        "m:phii1 in deg": "i_ang",
    }
    assert {name: signal_of(name).role for name in read} == read


def probed(folder: Path, *comments: str) -> Path:
    """Currents in mV of a probe of 4 mV/A, voltages behind a divider of 1:200."""
    names = ["Time (s)", "Va (V)", "Vb (V)", "Vc (V)", "Ia (mV)", "Ib (mV)", "Ic (mV)"]
    columns = [TIME, *(VALUES[:3] / 200), *(VALUES[3:] * 4)]
    return written(folder, "probes.csv", text(names, columns, above=comments))[0]


def test_probes_are_asked_for_once_and_one_answer_is_enough(tmp_path, capsys):
    path = probed(tmp_path, "Probe current: 4 mV/A", "Probe voltage: 1:200")
    out = ["--out", str(tmp_path / "events.out.csv")]
    assert cli.main(["import", str(path), *BASE, *out]) == 2
    asked = capsys.readouterr().err
    channels = "ia=5[0.25A],ib=6[0.25A],ic=7[0.25A]"
    assert f"add --channels {channels} (of 4 mV/A)" in asked
    assert "--ratio v=200 if on the secondary side" in asked
    assert_is_the_law(imported(path, "--ratio", "v=200", "--channels", channels))
    voltages = "va=2[200 V],vb=Vb[200V],vc=#4[2e2 V]"
    assert_is_the_law(imported(path, "--channels", f"{voltages},{channels}"))


def test_probes_of_which_nothing_is_told_are_asked_for_by_an_example(tmp_path):
    path = probed(tmp_path)
    with pytest.raises(ibrid.IbridError, match=r"ia=5\[0\.1A\],.* \(of 10 mV/A\)"):
        ibrid.read_events(path, **BASES)
    with pytest.raises(ibrid.IbridError, match=r"how many A one of its numbers is"):
        ibrid.read_events(path, channels="ia=5,ib=6,ic=7", **BASES)


def test_what_probes_give_for_an_ampere_is_read_in_several_ways():
    told = {
        "Probe: 10 mV/A": (0.01,),
        "shunt 0,05 V/A": (0.05,),
        "transducer 100 A/V": (0.01,),
        "2 V/kA": (0.002,),
        "10 mV/A and 100 mV/A": (0.01, 0.1),
        "1000 V / 5 A": (),
        "0 A/V": (),
    }
    assert {words: volts_per_ampere([words]) for words in told} == told


def test_channels_are_named_without_their_unit_and_numbered_with_a_sign(tmp_path):
    """A name of which two columns begin so is none; a column of the name itself is preferred."""
    names = ["Time", "U1-1[V]", "U1-2[V]", "U1-3[V]", "U2-1[A]", "U2-2[A]", "U2-3[A]"]
    (path,) = written(tmp_path, "daq.csv", text(names, [TIME, *VALUES]))
    for channels in (
        "va=U1-1,vb=U1-2,vc=U1-3,ia=U2-1,ib=U2-2,ic=U2-3",
        "va=#2,vb=#3,vc=#4,ia=#5,ib=#6,ic=#7",
        "va=#2[V],vb=3[V],vc=U1-3[V],ia=U2-1[A],ib=#6,ic=7",
    ):
        assert_is_the_law(ibrid.read_events(path, channels=channels, **BASES).records[0])
    with pytest.raises(ibrid.IbridError, match="there is no channel '#8' for va"):
        ibrid.read_events(path, channels="va=#8", **BASES)
    twice = [name.replace("U1-2[V]", "U1-1[kV]") for name in names]
    (path,) = written(tmp_path, "twice.csv", text(twice, [TIME, *VALUES]))
    with pytest.raises(ibrid.IbridError, match="there is no channel 'U1-1' for va"):
        ibrid.read_events(path, channels="va=U1-1", **BASES)


def test_a_table_of_unknown_columns_says_what_may_be_told_of_them(tmp_path):
    few = {"t [s]": TIME, "x": VA, "y": VB}
    (path,) = written(tmp_path, "xyz.csv", text(list(few), list(few.values())))
    with pytest.raises(ibrid.IbridError, match="found 3 channels, add those that lack"):
        ibrid.read_events(path, **BASES)
    more = {**few, "z": VA, "u": VB, "w": VA}
    (path,) = written(tmp_path, "more.csv", text(list(more), list(more.values())))
    with pytest.raises(ibrid.IbridError, match="or t=1,v_mag=2,v_ang=3,i_mag=4,i_ang=5"):
        ibrid.read_events(path, **BASES)


def clock_cells(form: str) -> list[str]:
    """The times of a clock that passes noon, with the mark between seconds and their parts."""
    begin = 12 * 3600 - 0.1
    return [
        f"{int(of_day // 3600):02d}:{int(of_day // 60) % 60:02d}:{of_day % 60:08.5f}".replace(
            ".", form
        )
        for of_day in (begin + TIME).round(5).tolist()
    ]


def test_clocks_have_their_names_in_other_languages(tmp_path):
    """Uhrzeit, heure, hora, with how the clock is written behind, and a date beside."""
    names = [f"{letter}{phase} [{unit}]" for letter, unit in ("UV", "IA") for phase in "123"]
    rows = [[f"{cell:.10g}".replace(".", ",") for cell in row] for row in VALUES.T.tolist()]
    with collecting() as failures:
        for name, form in (
            ("Uhrzeit", ","),
            ("Uhrzeit [hh:mm:ss,000]", ","),
            ("Zeit (hh:mm:ss)", "."),
            ("Heure", ","),
            ("Temps", "."),
            ("Hora", ","),
            ("Tiempo", "."),
            ("时间", "."),
            ("Datum;Uhrzeit", ","),
            ("Fecha;Hora (HH:MM:SS)", ","),
        ):
            with failures.case(name):
                date = "02.12.2026;" if ";" in name else ""
                lines = [";".join([name, *names])]
                lines += [
                    ";".join([f"{date}{stamp}", *row])
                    for stamp, row in zip(clock_cells(form), rows, strict=True)
                ]
                (path,) = written(tmp_path, "clock.csv", "\n".join([*lines, ""]))
                assert_is_the_law(imported(path))


def yokogawa(folder: Path, *, names: str = "U1,U2,U3,I1,I2,I3", step: str = "") -> Path:
    """Rows of names, units and sampling; no column of times, and an empty cell before each row."""
    interval = 1 / 5000
    steps = step.split(",") if step else [f"{interval:.6E}"] * 6
    head = {
        "Model Name": ["DL850E"],
        "TraceName": [f'"{name}"' for name in names.split(",")],
        "BlockSize": [str(len(TIME))] * 6,
        "VUnit": ['"V"'] * 3 + ['"A"'] * 3,
        "SampleRate": ["5.000E+03"] * 6,
        "HResolution": steps,
        "HOffset": ["-0.05"] * 6,
        "HUnit": ['"s"'] * 6,
    }
    lines = [",".join([f'"{word}"', *cells]) for word, cells in head.items()]
    rows = ["," + ",".join(f"{cell:.10g}" for cell in row) for row in VALUES.T.tolist()]
    return written(folder, "block.csv", "\n".join([*lines, "", *rows, ""]))[0]


def test_a_block_of_channels_is_named_and_timed_by_its_rows(tmp_path, capsys):
    """The record begins at HOffset; the law is that of times from 0 on."""
    for names, channels in (
        ("U1,U2,U3,I1,I2,I3", ()),
        ("CH1,CH2,CH3,CH4,CH5,CH6", ("--channels", "va=CH1,vb=CH2,vc=CH3,ia=CH4,ib=CH5,ic=CH6")),
    ):
        record = imported(yokogawa(tmp_path, names=names), *channels)
        assert record.time[0] == pytest.approx(-0.05)
        assert_is_the_law(replace(record, time=record.time + 0.05))
        assert "times made of a sample each 0.0002 s" in capsys.readouterr().err


def test_a_block_of_channels_in_several_ways_is_refused(tmp_path):
    path = yokogawa(tmp_path, step="1E-4,1E-4,1E-4,2E-4,2E-4,2E-4")
    with pytest.raises(ibrid.IbridError, match="one sampling interval"):
        ibrid.read_events(path, **BASES)
    path = yokogawa(tmp_path)
    path.write_text('"TraceName","A","B","C","D","E","F"\n' + path.read_text())
    with pytest.raises(ibrid.IbridError, match="one block of channels"):
        ibrid.read_events(path, **BASES)


def test_a_sampling_interval_or_rate_above_the_numbers_makes_the_times(tmp_path, capsys):
    names = ["va [V]", "vb [V]", "vc [V]", "ia [A]", "ib [A]", "ic [A]"]
    with collecting() as failures:
        for told in (
            "Sample interval: 0.0002 s",
            "Sample Interval,0.0002",
            "sampling time = 200 us",
            "Delta_X,0.0002",
            "dt [ms]: 0.2",
            "Sample rate: 5 kHz",
            "Sampling frequency [Hz]: 5000",
            "# sampled at 5 kS/s",
            "Fs = 5000",
            "Abtastrate: 5 kHz",
            "Fréquence d'échantillonnage : 5000 Hz",
            "Frecuencia de muestreo: 5 kHz",
            "采样频率: 5 kHz",
        ):
            with failures.case(told):
                content = text(names, list(VALUES), above=(told,))
                (path,) = written(tmp_path, "rate.csv", content)
                assert_is_the_law(imported(path))
                assert "times made of a sample each 0.0002 s" in capsys.readouterr().err


def test_words_that_tell_no_sampling_make_no_times():
    for words in ("offset: 3", "cutoff frequency: 5 kHz", "fs", "sample rate: 0 Hz", "dt: 3 V"):
        assert sampling_told([words]) is None


def slow(folder: Path, seconds: int) -> Path:
    """Values of a control room, of which some cells have no decimal comma, and times no seconds."""
    begin = np.datetime64("2026-12-02T11:00")
    stamps = [str(begin + np.timedelta64(seconds * k, "s"))[11:] for k in range(60)]
    stamps = [stamp + ":00" * (stamp.count(":") == 1 and seconds % 60 > 0) for stamp in stamps]
    powers = [8000.0] * 20 + [4000.5] * 40
    voltages = [20000.0] * 20 + [19000.0] * 40
    rows = [
        f"02.12.2026 {stamp};{p:g};1000;{v:g}".replace(".5;", ",5;")
        for stamp, p, v in zip(stamps, powers, voltages, strict=True)
    ]
    lines = ["Timestamp;P [kW];Q [kvar];U [V]", *rows, ""]
    return written(folder, "room.csv", "\n".join(lines))[0]


def test_one_value_a_minute_is_no_recording_of_a_controller(tmp_path):
    with pytest.raises(ibrid.IbridError, match="one value each 60 s, while even a plant contr"):
        ibrid.read_events(slow(tmp_path, 60), **BASES)


def test_one_value_in_five_seconds_is_said_to_show_a_plant_controller_at_most(tmp_path):
    """Whole numbers beside decimal commas in one column are numbers."""
    events = ibrid.read_events(slow(tmp_path, 5), **BASES)
    assert events.records[0].rest.p == pytest.approx(0.8)
    power = events.records[0].v[-1] @ events.records[0].i[-1]
    assert power == pytest.approx(0.40005, rel=1e-6)
    assert any("shows nothing above 0.1 Hz" in one for one in contradictions(events))


def test_phases_are_named_by_words_of_other_languages_in_old_encodings(tmp_path):
    french = [f"{word} phase {k}" for word in ("Tension", "Courant") for k in "123"]
    spanish = [f"{word} {phase}" for word in ("Tensión", "Corriente") for phase in "RST"]
    fases = [f"{word} fase {k}" for word in ("Tensión", "Corriente") for k in "123"]
    with collecting() as failures:
        for time, names in (("Temps", french), ("Tiempo", spanish), ("Tiempo", fases)):
            for encoding in ("utf-8", "latin-1"):
                with failures.case(f"{names[0]} in {encoding}"):
                    units = [" (V)"] * 3 + [" (A)"] * 3
                    head = [f"{name}{unit}" for name, unit in zip(names, units, strict=True)]
                    content = text([f"{time} (s)", *head], [TIME, *VALUES], ";", comma=True)
                    (path,) = written(tmp_path, "words.csv", content, encoding)
                    assert_is_the_law(imported(path))
