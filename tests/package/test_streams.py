"""Streams and file names that do not take every letter, a full disk, numbers that overflow: one
sentence, and nothing is lost.
"""

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from ibrid import cli
from ibrid.commands import vocabulary

HEAD = "op,p,q,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im\n"
ROW = "near,1,0.3,{},-0.3,0.4,0.1,0,-0.1,0,0.9,0.2\n"


def sweep_at(path: Path, *frequencies: str) -> Path:
    path.write_text(HEAD + "".join(ROW.format(one) for one in frequencies), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_file_name_that_is_no_text_is_told_and_its_record_is_read_again(tmp_path, capsys):
    try:
        data = sweep_at(tmp_path / os.fsdecode(b"sweep\xff.csv"), "5", "50", "500")
    except OSError:
        pytest.skip("names of files are text here")
    record = tmp_path / "fit.json"
    assert cli.main(["evaluate", "naive", str(data), "--restarts", "0", "--json", str(record)]) == 0
    assert cli.main(["report", str(record)]) == 0
    assert r"sweep\xff.csv" in json.loads(record.read_text(encoding="utf-8"))["settings"]["data"]
    assert r"sweep\xff.csv" in capsys.readouterr().out


@pytest.mark.slow
def test_an_output_of_ascii_shows_other_letters_as_escapes(tmp_path):
    data = sweep_at(tmp_path / "sweep.csv", "5", "50", "500")
    data.write_text(data.read_text(encoding="utf-8").replace("near", "Prüfling"), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "ibrid", "inspect", str(data)],
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii", "LANG": "C"},
    )
    assert done.returncode == 0
    assert rb"Pr\xfcfling" in done.stdout


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="this system has no /dev/full")
def test_an_output_that_is_full_loses_no_file(tmp_path):
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "ibrid",
                "sweep",
                "paper_like",
                "--freq",
                "5:500:3",
                "--out",
                str(tmp_path / "a.csv"),
            ],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("ibrid: standard output took not all of the answer")
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "a.csv").is_file()


@pytest.mark.parametrize(
    ("frequencies", "told"),
    [
        (("5", "1e300"), "must be 1e-12 to 1e+12 Hz; found 1e+300."),
        (("1e-300", "5"), "must be 1e-12 to 1e+12 Hz; found 1e-300."),
        (("5", "50.0", "50.000000000000014"), "must differ by more than 1e-09 of themselves"),
    ],
)
def test_frequencies_that_no_analyser_sweeps_are_one_sentence(frequencies, told, tmp_path, capsys):
    assert cli.main(["inspect", str(sweep_at(tmp_path / "sweep.csv", *frequencies))]) == 2
    assert told in capsys.readouterr().err


def test_what_numpy_says_of_its_numbers_is_not_for_the_terminal(monkeypatch, capsys):
    def table(_: object) -> str:
        warnings.warn("overflow encountered in square", RuntimeWarning, stacklevel=1)
        warnings.warn("a plug-in is missing", UserWarning, stacklevel=1)
        return "the table"

    monkeypatch.setattr(vocabulary, "vocabulary_table", table)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert cli.main(["modules"]) == 0
    assert capsys.readouterr().err == "ibrid: a plug-in is missing\n"


def test_words_of_foreign_length_are_cut_in_sentences(capsys):
    assert cli.main(["evaluate", "naive", "paper_like", "--holdout-op", "9" * 5000]) == 2
    heard = capsys.readouterr().err
    assert "... (5002 characters)" in heard
    assert len(heard) < 1000


def test_a_program_of_many_mistakes_tells_the_first(tmp_path, capsys):
    wrong = tmp_path / "wrong.py"
    lines = (f'    g.add("M{k}", "m{k}")\n' for k in range(100))
    wrong.write_text("".join(("def wrong(g):\n", *lines)), encoding="utf-8")
    assert cli.main(["evaluate", str(wrong), "paper_like"]) == 2
    heard = capsys.readouterr().err
    assert heard.endswith("wrong.py: 51 violations more\n")
