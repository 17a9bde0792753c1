"""Signs, arrows and further words in the names of columns, and how voltages, currents, angles and
set points are counted, are read as they are meant, or asked for.
"""

import numpy as np
import pytest
from recording_makes import F0, I_PEAK, S_BASE, V_BASE, P, Q, current, phases, text, times, voltage
from sweep_makes import first_point, parts, rows_of

import ibrid
from ibrid import cli
from ibrid.measurement.importing.importing import import_files

SAID = {"unit": "pu", "f0_hz": 60.0, "current": "out", "q_axis": "leads", "voltage_axis": "d"}
OPTIONS = ["--unit", "pu", "--f0-hz", "60", "--current", "out", "--q-axis", "leads"]
OPTIONS += ["--voltage-axis", "d", "--p", "1", "--q", "0.3"]
NAMES = [f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im")]
BASES = {"base": "10MVA,20kV", "f0_hz": F0}


@pytest.fixture(scope="module")
def truth():
    return first_point(ibrid.read_sweep(ibrid.benchmarks()["paper_like"]))[:2]


def imported(folder, names, columns, *more):
    """What `ibrid import` says of a table, and the admittances that it read, None where it asks."""
    path, out = folder / "scan.csv", folder / "read.csv"
    path.write_text(rows_of(names, columns))
    out.unlink(missing_ok=True)
    status = cli.main(["import", str(path), *OPTIONS, *more, "--out", str(out)])
    return None if status else ibrid.read_sweep(out).points[0].admittance


def test_a_minus_before_a_name_is_its_sign(truth, tmp_path, capsys):
    frequency, matrix = truth
    cells = parts(matrix)
    wrong = []
    for write in ("-Im(Y{0})", "- Im Y{0}", "−Y{0}_im", "Im(-Y{0})"):
        names = [
            name
            for entry in ("dd", "dq", "qd", "qq")
            for name in (f"Re(Y{entry})", write.format(entry))
        ]
        columns = [cell * (-1 if k % 2 else 1) for k, cell in enumerate(cells)]
        read = imported(tmp_path, ["f", *names], [frequency, *columns])
        said = capsys.readouterr().err
        if read is None or not np.allclose(read, matrix) or "other sign" not in said:
            wrong.append((write, said))
    assert wrong == []


def test_a_minus_before_a_power_or_a_current_is_its_sign(truth, tmp_path, capsys):
    frequency, matrix = truth
    names = ["f", "-p", "q", *NAMES]
    columns = [frequency, np.full_like(frequency, -0.7), np.full_like(frequency, 0.2)]
    (tmp_path / "scan.csv").write_text(rows_of(names, [*columns, *parts(matrix)]))
    sweep = import_files([tmp_path / "scan.csv"], **SAID).answered()
    assert sweep.points[0].op.p == pytest.approx(0.7)

    time = times()
    volts = [V_BASE * np.sqrt(2 / 3) * one for one in phases(voltage(time), time)]
    amperes = [-I_PEAK * one for one in phases(current(time), time)]
    heads = ["t", "va [V]", "vb [V]", "vc [V]", "-ia [A]", "-ib [A]", "-ic [A]"]
    (tmp_path / "rec.csv").write_text(text(heads, [time, *volts, *amperes]))
    rest = ibrid.read_events(tmp_path / "rec.csv", **BASES).records[0].rest
    assert [rest.p, rest.q] == pytest.approx([P, Q], abs=1e-5)


def test_an_arrow_leads_from_what_is_injected_to_what_answers(truth, tmp_path):
    frequency, matrix = truth
    wrong = []
    for arrow in ("->", " → ", " to "):
        pairs = [("d", "d"), ("q", "d"), ("d", "q"), ("q", "q")]
        names = [f"{part} Y {a}{arrow}{b}" for a, b in pairs for part in ("Re", "Im")]
        read = imported(tmp_path, ["f", *names], [frequency, *parts(matrix)])
        if read is None or not np.allclose(read, matrix):
            wrong.append(arrow)
    assert wrong == []


def test_words_that_change_what_a_matrix_is_are_asked_for(truth, tmp_path, capsys):
    frequency, matrix = truth
    mapped = "--map", "Ydd=#2+j#3,Ydq=#4+j#5,Yqd=#6+j#7,Yqq=#8+j#9"
    wrong = []
    for before in ("Yconj", "Y_neg", "Yt_", "Ygrid_", "Yalphabeta", "Y*", "Y'", "Y_inverse_"):
        names = [f"{before}{entry}" for entry in ("dd", "dq", "qd", "qq")]
        heads = ["f", *(f"{name}_{part}" for name in names for part in ("re", "im"))]
        columns = [frequency, *parts(matrix)]
        if imported(tmp_path, heads, columns) is not None:
            wrong.append((before, "read"))
        if "--map" not in capsys.readouterr().err:
            wrong.append((before, "not asked"))
        if imported(tmp_path, heads, columns, *mapped) is None:
            wrong.append((before, capsys.readouterr().err))
    assert wrong == []


def test_words_of_the_inverter_are_read_and_unknown_ones_are_said(truth, tmp_path, capsys):
    frequency, matrix = truth
    remarks = {"dut": False, "vsc": False, "inv": True, "xyz": True}
    wrong = []
    for word, remarked in remarks.items():
        names = [f"Y{word}_{name[1:]}" for name in NAMES]
        read = imported(tmp_path, ["f", *names], [frequency, *parts(matrix)])
        said = f"Y{word}_dd_re: " in capsys.readouterr().err
        if read is None or not np.allclose(read, matrix) or said != remarked:
            wrong.append(word)
    assert wrong == []


def test_a_reference_with_a_star_is_no_measured_current(tmp_path):
    time = times()
    v, i = voltage(time), current(time)
    names = ["t", "vd", "vq", "id*", "id", "iq*", "iq"]
    stars = [np.zeros_like(time), i.real, np.zeros_like(time), i.imag]
    (tmp_path / "rec.csv").write_text(text(names, [time, v.real, v.imag, *stars]))
    rest = ibrid.read_events(tmp_path / "rec.csv", unit="pu", f0_hz=F0).records[0].rest
    assert [rest.p, rest.q] == pytest.approx([P, Q], abs=1e-6)


def frames(size, ampere, *, radians=False):
    """Times, and magnitude and angle of voltage and current at 1000 frames in a second."""
    time = times(1000.0)
    v, i = voltage(time), current(time)
    angle = np.angle if radians else (lambda value: np.angle(value, deg=True))
    return [time, size * abs(v), angle(v), ampere * abs(i), angle(i)]


def test_peak_and_rms_values_are_read_as_their_units_say(tmp_path):
    line_rms = S_BASE / (np.sqrt(3) * V_BASE)
    cases = [
        ("kV", V_BASE / np.sqrt(3) / 1e3, "A pk", line_rms * np.sqrt(2)),
        ("kV", V_BASE * np.sqrt(2 / 3) / 1e3, "A", line_rms * np.sqrt(2)),
        ("kV", V_BASE * np.sqrt(2 / 3) / 1e3, "A rms", line_rms),
        ("kV_LL peak", V_BASE * np.sqrt(2) / 1e3, "A rms", line_rms),
        ("kV_LN", V_BASE / np.sqrt(3) / 1e3, "A rms", line_rms),
        ("kV rms", V_BASE / 1e3, "A rms", line_rms),
    ]
    wrong = []
    for volts, size, amperes, ampere in cases:
        heads = ["t", f"v_mag [{volts}]", "v_ang [deg]", f"i_mag [{amperes}]", "i_ang [deg]"]
        (tmp_path / "rec.csv").write_text(text(heads, frames(size, ampere)))
        rest = ibrid.read_events(tmp_path / "rec.csv", **BASES).records[0].rest
        if not np.allclose([rest.p, rest.q, rest.v], [P, Q, 1], atol=1e-4):
            wrong.append((volts, amperes, rest))
    assert wrong == []


def test_rms_of_no_known_size_is_asked_for_and_can_be_said(tmp_path):
    heads = ["t", "v_mag [kV rms]", "v_ang [deg]", "i_mag [A rms]", "i_ang [deg]"]
    line_rms = S_BASE / (np.sqrt(3) * V_BASE)
    (tmp_path / "rec.csv").write_text(text(heads, frames(0.85 * V_BASE / 1e3, line_rms)))
    with pytest.raises(ibrid.IbridError, match=r"v_mag=2\[kV_LL\]"):
        ibrid.read_events(tmp_path / "rec.csv", **BASES)
    told = ibrid.read_events(tmp_path / "rec.csv", channels={"v_mag": "2[kV_LL]"}, **BASES)
    assert told.records[0].rest.v == pytest.approx(0.85, abs=1e-4)


def test_small_angles_without_a_unit_are_asked_for(tmp_path):
    heads = ["t", "v_mag", "v_ang", "i_mag", "i_ang"]
    (tmp_path / "rec.csv").write_text(text(heads, frames(1.0, 1.0, radians=True)))
    with pytest.raises(ibrid.IbridError, match=r"i_ang=5\[rad\]"):
        ibrid.read_events(tmp_path / "rec.csv", unit="pu", f0_hz=F0)
    channels = {"v_ang": "3[rad]", "i_ang": "5[rad]"}
    told = ibrid.read_events(tmp_path / "rec.csv", unit="pu", f0_hz=F0, channels=channels)
    assert [told.records[0].rest.p, told.records[0].rest.q] == pytest.approx([P, Q], abs=1e-4)


def test_angles_of_three_phases_tell_radians_by_their_size(tmp_path):
    time = times(1000.0)
    heads, columns = ["t"], [time]
    for letter, value in (("v", voltage(time)), ("i", current(time))):
        for k, phase in enumerate("abc"):
            turned = value * np.exp(-2j * np.pi / 3 * k)
            heads += [f"{letter}{phase}_mag", f"{letter}{phase}_ang"]
            columns += [abs(turned), np.angle(turned)]
    (tmp_path / "rec.csv").write_text(text(heads, columns))
    record = ibrid.read_events(tmp_path / "rec.csv", unit="pu", f0_hz=F0).records[0]
    assert [record.rest.p, record.rest.q] == pytest.approx([P, Q], abs=1e-4)
    assert any("in radians" in one for one in record.remarks)


def test_set_points_have_the_unit_of_the_recording(tmp_path):
    time = times(1000.0)
    v = abs(voltage(time))
    power = voltage(time) * np.conj(current(time))
    rows = [time, 20 * v, 10 * power.real, 10 * power.imag]
    heads = ["t", "v [kV]", "p [MW]", "q [Mvar]"]
    read = {}
    for name, value in {
        "q_ref [pu]": 0.1,
        "p_ref [MW]": 8.0,
        "v_ref [kV]": 20.0,
        "f_ref [Hz]": 60.0,
    }.items():
        (tmp_path / "rec.csv").write_text(text([*heads, name], [*rows, np.full_like(time, value)]))
        read |= ibrid.read_events(tmp_path / "rec.csv", **BASES).records[0].told
    assert {name: value[0] for name, value in read.items()} == pytest.approx(
        {"q_ref": 0.1, "p_ref": 0.8, "v_ref": 1.0, "f_ref": 60.0}
    )
    for name, value in {"p_ref": 8.0, "v_ref": 1.0, "f_ref": 1.0}.items():
        (tmp_path / "rec.csv").write_text(text([*heads, name], [*rows, np.full_like(time, value)]))
        with pytest.raises(ibrid.IbridError, match="the set point"):
            ibrid.read_events(tmp_path / "rec.csv", **BASES)


def test_a_voltage_of_the_size_of_a_phase_is_asked_for(truth, tmp_path, capsys):
    frequency, matrix = truth
    heads = ["f", "v [V]", *NAMES]
    columns = [frequency, np.full_like(frequency, 326.6), *parts(matrix)]
    base = ("--base", "10kVA,400V")
    assert imported(tmp_path, heads, columns, *base) is None
    assert '--map "v=v [V][V_peak]"' in capsys.readouterr().err
    assert imported(tmp_path, heads, columns, *base, "--map", "v=v [V][V_peak]") is not None
    assert ibrid.read_sweep(tmp_path / "read.csv").points[0].op.v == pytest.approx(1, abs=1e-3)


def test_a_power_without_a_unit_beside_one_in_kilowatts_is_asked_for(truth, tmp_path, capsys):
    frequency, matrix = truth
    heads = ["f", "p [kW]", "q", *NAMES]
    steady = [np.full_like(frequency, 8.0), np.full_like(frequency, 2.0)]
    (tmp_path / "scan.csv").write_text(rows_of(heads, [frequency, *steady, *parts(matrix)]))
    asked = import_files([tmp_path / "scan.csv"], base="10kVA,400V", **SAID)
    assert "the unit of q" in asked.asked
    told = import_files([tmp_path / "scan.csv"], ["q=q[kvar]"], base="10kVA,400V", **SAID)
    assert told.answered().points[0].op.q == pytest.approx(0.2)


def test_impedances_beside_admittances_must_be_their_inverses(truth, tmp_path):
    frequency, matrix = truth
    heads = ["f", *NAMES, *(f"Z{name[1:]}" for name in NAMES)]
    powers = {"p": 1.0, "q": 0.3}
    asked = {}
    for name, impedance in {"inverse": 3 * np.linalg.inv(matrix), "other": matrix}.items():
        (tmp_path / "scan.csv").write_text(
            rows_of(heads, [frequency, *parts(matrix), *parts(impedance)])
        )
        asked[name] = import_files([tmp_path / "scan.csv"], **SAID, **powers).questions
    assert asked["inverse"] == ()
    assert "not the inverse" in asked["other"][0].sentence
    told = import_files([tmp_path / "scan.csv"], quantity="Z", **SAID, **powers).answered()
    assert np.allclose(told.points[0].admittance, np.linalg.inv(matrix))


def test_clocks_may_say_their_zone(tmp_path, recwarn):
    time = times(1000.0)
    v, i = voltage(time), current(time)
    stamps = [f"2026-03-29T02:59:59.{round(1e3 * t):03d}+02:00" for t in time]
    rows = zip(stamps, v.real, v.imag, i.real, i.imag, strict=True)
    lines = [",".join([stamp, *(f"{one:.9g}" for one in cells)]) for stamp, *cells in rows]
    (tmp_path / "rec.csv").write_text("\n".join(["t,vd,vq,id,iq", *lines, ""]))
    record = ibrid.read_events(tmp_path / "rec.csv", unit="pu", f0_hz=F0).records[0]
    assert record.time[-1] == pytest.approx(time[-1])
    assert [str(one.message) for one in recwarn] == []


def test_real_matrices_are_no_admittances(truth):
    frequency, matrix = truth
    with pytest.raises(ibrid.IbridError, match="complex"):
        ibrid.read_sweep((frequency, matrix.real), p=1.0, q=0.3, f0_hz=60.0)
