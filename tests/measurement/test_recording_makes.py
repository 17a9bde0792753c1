"""Recordings as programs and recorders write them: each make becomes the law that it was written
from, with one command.
"""

from pathlib import Path

import numpy as np
import pytest
from recording_makes import MAKES, WRONG, P, Q, current, pmu, table, voltage

import ibrid
from ibrid import cli
from ibrid.measurement.formats.bundle import is_there


def test_makes_of_recording_become_the_law_that_they_were_written_from(tmp_path, capsys):
    """p, q and v at rest, and every sample, to the digits that the file has."""
    wrong = []
    for number, made in enumerate(MAKES):
        folder = tmp_path / str(number)
        folder.mkdir()
        files = [str(path) for path in made.write(folder)]
        out = folder / "events.out.csv"
        if cli.main(["import", *files, *made.options, "--out", str(out)]):
            wrong.append((made.make, capsys.readouterr().err))
            continue
        (record,) = ibrid.read_events(out).records
        rest = np.abs(np.subtract([record.rest.p, record.rest.q, record.rest.v], [P, Q, 1])).max()
        time, turn = record.time - 0.2 * ("start-up" in made.make), np.exp(-1j * np.deg2rad(13))
        errors = [
            np.abs(getattr(record, name) @ [1, 1j] - law(time) * turn).max() for name, law in _LAWS
        ]
        if max(rest, *errors) > made.digits:
            wrong.append((made.make, rest, errors))
    assert wrong == []


_LAWS = (("v", voltage), ("i", current))


def test_recordings_that_are_wrong_on_purpose_are_caught(tmp_path, capsys):
    silent = []
    for number, (made, sentence) in enumerate(WRONG):
        folder = tmp_path / str(number)
        folder.mkdir()
        cli.main(
            [
                "import",
                *map(str, made.write(folder)),
                *made.options,
                "--out",
                str(folder / "events.out.csv"),
            ]
        )
        if sentence not in (said := capsys.readouterr().err):
            silent.append((made.make, said))
    assert silent == []


def test_waveforms_and_frames_of_an_estimator_are_not_one_file(tmp_path, capsys):
    """An events file says one window of all its records."""
    files = [str(path) for write in (pmu, table("t|va|vb|vc|ia|ib|ic")) for path in write(tmp_path)]
    out = ["--base", "10MVA,20kV", "--out", str(tmp_path / "events.out.csv")]
    assert cli.main(["import", *files, *out]) == 2
    assert (
        "must be waveforms, or frames of one estimator; import them one by one"
        in capsys.readouterr().err
    )


def test_a_clock_that_is_put_back_is_said_of_tables_too(tmp_path):
    stamps = [
        f"2026-10-25T{hour}:59:59.{k:02d}"
        for hour, k in (("02", 1), ("02", 2), ("01", 3), ("01", 4))
    ]
    rows = [f"{stamp},1,0.5,0.1" for stamp in stamps]
    (tmp_path / "a.csv").write_text("\n".join(["Time,u [pu],p [pu],q [pu]", *rows]))
    with pytest.raises(ibrid.IbridError, match="goes back by an hour"):
        ibrid.read_events(tmp_path / "a.csv")


def test_powers_at_a_voltage_of_nearly_nothing_tell_no_current_of_nearly_everything(tmp_path):
    """Below a thousandth of the largest voltage p and q are noise: the current is that of the
    thousandth, 0.1 per unit here.
    """
    rows = [
        f"{k / 1000:g},{1e-6 if 200 <= k < 300 else 1},{1e-4 if 200 <= k < 300 else 0.5},0"
        for k in range(500)
    ]
    (tmp_path / "a.csv").write_text("\n".join(["t [s],u [pu],p [pu],q [pu]", *rows]))
    (record,) = ibrid.read_events(tmp_path / "a.csv", window="none", f0_hz=50).records
    assert abs(record.i @ [1, 1j]).max() < 0.51


def test_pscad_without_a_description_says_which_file_to_copy(tmp_path):
    (tmp_path / "run_01.out").write_text("\n".join(f"{k * 1e-4:g} 1 2 3 4 5 6" for k in range(900)))
    with pytest.raises(
        ibrid.IbridError, match=r"copy run\.inf or \.infx, which PSCAD writes beside it"
    ):
        ibrid.read_events(tmp_path / "run_01.out", base="10MVA,20kV")


def test_archives_and_compressed_files_that_are_none_are_one_sentence(tmp_path, capsys):
    for name, content, sentence in (
        ("a.zip", b"PK\3\4 and no more", "must be a zip archive; it cannot be read"),
        ("a.csv.gz", b"\x1f\x8b\x08\0" + b"\0" * 20, "begins as gzip and is damaged"),
        ("a.csv.xz", b"\xfd7zXZ\0" + b"\0" * 20, "begins as xz and is damaged"),
    ):
        (tmp_path / name).write_bytes(content)
        assert cli.main(["import", str(tmp_path / name), "--out", str(tmp_path / "out.csv")]) == 2
        assert sentence in capsys.readouterr().err


def test_a_name_that_no_file_can_have_is_one_sentence():
    for path in ("a" * 5000, "a" * 5000 + ".zip/b.csv", "a\0b"):
        with pytest.raises(ibrid.IbridError):
            ibrid.read_events(path)
        assert not is_there(Path(path))


def test_a_small_file_that_unpacks_to_much_is_refused(tmp_path, monkeypatch):
    import gzip

    from ibrid.measurement.formats import bundle

    monkeypatch.setattr(bundle, "LARGEST", 10_000)
    (tmp_path / "bomb.csv.gz").write_bytes(gzip.compress(b"0" * 1_000_000))
    with pytest.raises(ibrid.IbridError, match="once it is unpacked"):
        ibrid.read_events(tmp_path / "bomb.csv.gz")


def test_an_out_file_that_begins_with_words_is_no_output_of_pscad_unless_it_is_described(tmp_path):
    from ibrid.measurement.importing.timed.pscad_output import is_pscad_output

    for name, first in (("a.out", "! a comment"), ("b.out", "0.0 1 2"), ("c.out", "a title")):
        (tmp_path / name).write_text(f"{first}\n0.1 2 3\n")
    (tmp_path / "c.inf").write_text('PGB(1) Output Desc="Va"')
    known = [is_pscad_output(tmp_path / f"{stem}.out") for stem in "abc"]
    assert known == [False, True, True]
    assert is_pscad_output(tmp_path / "none.out")
