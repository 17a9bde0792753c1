"""Bases, frequency and ratios of transformers in the comments of a recording."""

from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid import cli
from ibrid.measurement.importing.doubts.transformer_ratio import ratios_said

TIME = np.arange(0, 0.2, 5e-4)
PHASES = 2 * np.pi * (50 * TIME[:, None] - np.arange(3) / 3)


def recording(folder: Path, *comments: str, v_ratio: float = 1.0, i_ratio: float = 1.0) -> Path:
    """10 kVA, 400 V at half its current, in V and A, divided by the ratios of transformers."""
    volts = 400 * np.sqrt(2 / 3) * np.cos(PHASES)
    amperes = 0.5 * 10e3 / 400 * np.sqrt(2 / 3) * np.cos(PHASES)
    rows = np.column_stack([TIME, volts / v_ratio, amperes / i_ratio])
    head = "t [s],va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    lines = [*(f"# {comment}" for comment in comments), head]
    lines += [",".join(f"{cell:.7g}" for cell in row) for row in rows.tolist()]
    path = folder / "recording.csv"
    path.write_text("\n".join(lines))
    return path


def test_bases_in_the_words_of_a_data_sheet_are_read(tmp_path):
    wrong = []
    for comments in (
        ("Sn = 10 kVA", "Un = 400 V", "fn = 50 Hz"),
        ("s_base_va: 10 kVA", "v_base_v: 0.4 kV", "f0_hz: 50 Hz"),
        ("Rating: S_base = 0.01 MVA, V_base = 400 V, f0 = 50 Hz",),
        ("s_base_va: 10e3", "v_base_v: 400", "f0_hz: 50"),
    ):
        events = ibrid.read_events(recording(tmp_path, *comments))
        read = (events.s_base_va, events.v_base_v, events.f0_hz)
        p = events.records[0].rest.p
        if read != pytest.approx((10e3, 400.0, 50.0)) or p != pytest.approx(0.5, abs=1e-3):
            wrong.append((comments, read, p))
    assert wrong == []


def test_what_is_told_wins_over_the_words_of_comments(tmp_path):
    path = recording(tmp_path, "Sn = 20 kVA", "Un = 400 V")
    assert ibrid.read_events(path, base="10kVA,400V", f0_hz=50.0).s_base_va == 10e3


ASKED = "on which side of transformers or probes"


def test_ratios_of_transformers_and_secondary_values_are_asked_for(tmp_path):
    """Each question names the ratio that the comment tells, or an example of one."""
    wrong = []
    for comment, ratio in (
        ("CT 1000/5", "i=1000/5"),
        ("CT ratio 200:1", "i=200"),
        ("VT: 20000 V / 100 V", "v=20000/100"),
        ("VT 20 kV / 100 V, CT 400/1", "v=20000/100,i=400"),
        ("VT 20000/sqrt(3) : 100/sqrt(3) V", "v=20000/100"),
        ("current transformer 600 A : 5 A", "i=600/5"),
        ("Stromwandler 1000/1 A", "i=1000"),
        ("Probe voltage: 1:200", "v=200"),
        ("transformateur de courant 300/5", "i=300/5"),
        ("CT primary 600, secondary 5", "v=63000/100,i=1000/5"),
        ("values are secondary", "v=63000/100,i=1000/5"),
        ("Sekundärwerte; sekundär gemessen", "v=63000/100,i=1000/5"),
    ):
        path = recording(tmp_path, comment)
        try:
            ibrid.read_events(path, base="10kVA,400V", f0_hz=50.0)
            wrong.append((comment, "read"))
        except ibrid.IbridError as asked:
            words = (ASKED, f'ratio="{ratio}" if on the secondary', "ratio=1 if on the primary")
            wrong += [(comment, str(asked)) for one in words if one not in str(asked)]
    assert wrong == []


def test_other_numbers_beside_slashes_are_no_ratios(tmp_path):
    asked = []
    for comment in (
        "date 12/05/2026",
        "fault at bus 3/4",
        "scope: 10 MS/s",
        "PT1 filter",
        "transformer 690 V / 20 kV, Dyn5",
        "CT checked 12/05/2026",
        "Probe attenuation,1,1,1",
    ):
        try:
            ibrid.read_events(recording(tmp_path, comment), base="10kVA,400V", f0_hz=50.0)
        except ibrid.IbridError as error:
            asked.append((comment, str(error)))
    assert asked == []


def test_values_that_are_called_primary_are_taken_as_such(tmp_path):
    for comment in ("CT ratio 100/5 A, values are primary", "Primärwerte; Stromwandler 100/5 A"):
        events = ibrid.read_events(recording(tmp_path, comment), base="10kVA,400V", f0_hz=50.0)
        assert any("values of the primary side" in note for note in events.notes)
        assert events.records[0].rest.p == pytest.approx(0.5, abs=1e-3)


def test_a_ratio_that_is_said_brings_secondary_values_to_the_primary_side(tmp_path, capsys):
    """The file is one of 40 V and 1/20 of the current; the law is that of the primary side."""
    path = recording(tmp_path, "secondary values", v_ratio=10.0, i_ratio=20.0)
    out = tmp_path / "out.csv"
    said = ["import", str(path), "--base", "10kVA,400V", "--f0-hz", "50", "--out", str(out)]
    assert cli.main(said) == 2
    assert "--ratio v=63000/100,i=1000/5 if on the secondary side" in capsys.readouterr().err
    assert cli.main([*said, "--ratio", "v=400/40,i=20"]) == 0
    rest = ibrid.read_events(out).records[0].rest
    assert (rest.v, rest.p) == pytest.approx((1.0, 0.5), abs=1e-3)
    assert "voltages times 10, currents times 20" in capsys.readouterr().err
    for ratio in ("v=400/40,i=100/5", {"v": 10, "i": 20}):
        events = ibrid.read_events(path, base="10kVA,400V", f0_hz=50.0, ratio=ratio)
        assert events.records[0].rest.p == pytest.approx(0.5, abs=1e-3)
    (tmp_path / "recording.csv.meta").write_text("ratio: v=10,i=20\n")
    assert ibrid.read_events(path, base="10kVA,400V", f0_hz=50.0).records[0].rest.p > 0.49


def test_a_ratio_multiplies_powers_by_that_of_voltage_and_current():
    ratios = ratios_said("v=10,i=20")
    roles = ("va", "vab", "v_mag", "v_ang", "ia", "iq", "p", "q", "t", "f", "sigma", "record")
    factors = [10, 10, 10, 1, 20, 20, 200, 200, 1, 1, 1, 1]
    assert [ratios.of(role) for role in roles] == factors


def test_a_ratio_that_cannot_be_is_one_sentence(tmp_path):
    path = recording(tmp_path)
    for ratio in ("200", "v=0", "w=3", "v=1/0", "v=2,v=3", "v=a", ""):
        with pytest.raises(ibrid.IbridError, match="ratio is written v=63000/100"):
            ibrid.read_events(path, base="10kVA,400V", ratio=ratio)


def test_a_ratio_is_refused_where_values_are_known_to_be_primary_or_per_unit(tmp_path):
    path = recording(tmp_path)
    own = tmp_path / "own.csv"
    ibrid.write_events(ibrid.read_events(path, base="10kVA,400V", f0_hz=50.0), own)
    with pytest.raises(ibrid.IbridError, match="is an events file"):
        ibrid.read_events(own, ratio="v=10")
    relative = tmp_path / "pu.csv"
    head, *rows = path.read_text().splitlines()
    relative.write_text("\n".join([head.replace("[V]", "[pu]").replace("[A]", "[pu]"), *rows]))
    with pytest.raises(ibrid.IbridError, match="these are per unit; leave it out"):
        ibrid.read_events(relative, ratio="v=10")


def test_other_commands_say_where_a_ratio_is_said(tmp_path, capsys):
    path = recording(tmp_path, "CT 1000/5")
    assert cli.main(["start", str(path), "--base", "10kVA,400V", "--out", str(tmp_path / "a")]) == 2
    error = capsys.readouterr().err
    assert "options of ibrid import" in error
    assert "such as ratio: 1" in error


def test_a_ratio_is_of_recordings_alone(tmp_path, capsys):
    (tmp_path / "sweep.csv").write_text("f [Hz],Ydd\n10,1+1j\n20,1+2j\n30,1+3j\n")
    said = ["import", str(tmp_path / "sweep.csv"), "--ratio", "1", "--out", str(tmp_path / "o.csv")]
    assert cli.main(said) == 2
    assert "--ratio says something of records in time" in capsys.readouterr().err
