"""Anybody's table: twenty makes of file become the same sweep with one command and at most one --map."""

import numpy as np
from foreign_files import MAKES

import ibrid
from ibrid import cli


def test_twenty_makes_of_file_become_the_sweep_that_they_were_written_from(tmp_path, capsys):
    """The matrices agree to the digits that the file has, and names need no quotes."""
    truth = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    wrong = []
    for number, foreign in enumerate(MAKES):
        folder = tmp_path / str(number)
        folder.mkdir()
        files = [str(path) for path in foreign.write(truth, folder)]
        out = folder / "sweep.csv"
        status = cli.main(["import", *files, *foreign.options, "--out", str(out)])
        said = capsys.readouterr()
        if status:
            wrong.append((foreign.make, said.err, said.out))
            continue
        sweep = ibrid.read_sweep(out)
        for point, true in zip(sweep.points, truth.points, strict=False):
            same = point.admittance.shape == true.admittance.shape
            error = np.abs(point.admittance - true.admittance).max() / np.abs(true.admittance).max() if same else np.inf
            powers = np.abs(np.subtract([point.op.p, point.op.q, point.op.v], [true.op.p, true.op.q, true.op.v])).max()
            if error > foreign.digits or powers > 1e-9 or "," in point.op.name:
                wrong.append((foreign.make, point.op.name, error, powers, said.err))
    assert wrong == []


TABLE = "f,p,q," + ",".join(f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im"))
ROWS = "\n".join(f"{f},1,0.3,-1,0.1,0.3,0,0.3,0,1,0.1" for f in (1, 2, 4, 8))
SAID = ("--unit", "pu", "--f0-hz", "50", "--current", "out", "--q-axis", "leads")


def imported(tmp_path, text, *options):
    """The exit status of the command, and the folder's sweep."""
    (tmp_path / "table.csv").write_text(text)
    return cli.main(["import", str(tmp_path / "table.csv"), *options, "--out", str(tmp_path / "sweep.csv")])


def test_what_nobody_said_is_asked_for_at_once_with_the_options_to_add(tmp_path, capsys):
    assert imported(tmp_path, f"{TABLE}\n{ROWS}\n") == 2
    asked = capsys.readouterr().err
    assert all(words in asked for words in ("--unit pu or --unit S --base", "--f0-hz 50 or --f0-hz 60"))
    assert not (tmp_path / "sweep.csv").exists()
    resistive = "\n".join(
        f"{f},1,0.3,1,0,0,0,0,0,1,0" for f in (100, 200, 400, 800)
    )  # neither law has anything to hold on to
    assert imported(tmp_path, f"{TABLE}\n{resistive}\n", "--unit", "pu", "--f0-hz", "50") == 2
    assert "--current out or --current in" in capsys.readouterr().err


def test_signs_that_the_data_show_are_not_asked_for(tmp_path, capsys):
    """Law: Y(0) = -[[p, -q], [-q, -p]] with the current out and q leading; here settled from 1 Hz on."""
    for current, q_axis, sign, mirror in (("out", "leads", 1, 1), ("in", "leads", -1, 1), ("out", "lags", 1, -1)):
        rows = "\n".join(
            f"{f},1,0.3,{-sign},0,{0.3 * sign * mirror},0,{0.3 * sign * mirror},0,{sign},0" for f in (1, 1.1, 1.2, 40)
        )
        assert imported(tmp_path, f"{TABLE}\n{rows}\n", "--unit", "pu", "--f0-hz", "50") == 0
        said = capsys.readouterr().err
        assert f"current: {current}" in said
        assert f"q_axis: {q_axis}" in said


def test_the_positive_sequence_alone_is_read_with_a_word_on_what_it_cannot_tell(tmp_path, capsys):
    """Of an inductance, which couples nothing: Z = j omega L in the network is L (s + omega_0 J) in dq."""
    frequency = np.arange(10.0, 1000.0, 10.0)
    rows = "\n".join(f"{f:g},{0:g},{2 * np.pi * f * 0.1 / (2 * np.pi * 50):.15g}" for f in frequency)
    options = ("--p", "0.5", "--q", "0", "--unit", "pu", "--f0-hz", "50", "--current", "in")
    assert imported(tmp_path, f"Frequency (Hz),Zpos_re,Zpos_im\n{rows}\n", *options) == 0
    assert "cannot be told from these data" in capsys.readouterr().err
    (point,) = ibrid.read_sweep(tmp_path / "sweep.csv").points
    s = 2j * np.pi * point.frequency[:, None, None]
    expected = -np.linalg.inv(0.1 * (s / (2 * np.pi * 50) * np.eye(2) + np.array([[0, -1], [1, 0]])))
    kept = (
        np.abs(point.frequency - 50) > 10
    )  # at f0 the network's frequency is zero, an ideal inductance a short circuit
    np.testing.assert_allclose(
        point.admittance[kept], expected[kept], rtol=0.05, atol=0.02
    )  # interpolated between 10 Hz


def test_a_table_that_cannot_be_understood_is_one_sentence(tmp_path, capsys):
    cases = {
        "no numbers here\n": "rows of numbers",
        f"{TABLE}\n{ROWS}\n8,1,0.3\n9,1,0.3,-1,0.1,0.3,0,0.3,0,1,0.1\n": "line 6",
        "a,b,c\n1,2,3\n2,3,4\n3,4,5\n": "column of frequencies",
        "f,b,c\n1,2,3\n2,3,4\n3,4,5\n": "--map Ydd=A+jB",
        f"{TABLE.replace('p,q', 'P [kW],q')}\n{ROWS}\n": "--base",
    }
    for text, expected in cases.items():
        assert imported(tmp_path, text, *SAID) == 2
        said = capsys.readouterr().err.splitlines()
        assert any(expected in line for line in said), (text, said)
    assert imported(tmp_path, f"{TABLE}\n{ROWS}\n", *SAID, "--map", "freq=ff") == 2
    assert "no such column" in capsys.readouterr().err
