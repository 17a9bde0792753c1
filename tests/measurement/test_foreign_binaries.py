"""Binary files of others are read elsewhere: whatever a reader does there is one sentence here."""

import io
import random
import sys
from pathlib import Path

import foreign_readers
import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement import guarded as guard
from ibrid.measurement.guarded import guarded
from ibrid.measurement.matlab import read_mat

POSIX = pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is bounded on Linux alone for certain")


def test_what_a_reader_finds_comes_back():
    held = guarded(foreign_readers.plain, b"\x01\x02", "it")
    assert held["x"].tolist() == [1, 2]
    assert held["word"].item() == "abc"


@pytest.mark.parametrize(
    ("reader", "words"),
    [
        ("crashes", "ends the process that reads it"),
        ("exits", "ends the process that reads it"),
        ("raises", r"cannot be read \('one.*three'\)"),
        pytest.param("swells", "needs too much memory", marks=POSIX),
        pytest.param("floods", "ends the process|cannot be read", marks=POSIX),
        pytest.param("answers_much", "needs too much memory", marks=POSIX),
    ],
)
def test_a_reader_that_fails_is_one_sentence(reader, words):
    with pytest.raises(SweepError, match=f"^it; .*{words}") as caught:
        guarded(getattr(foreign_readers, reader), b"", "it")
    assert len(str(caught.value).splitlines()) == 1


def test_a_reader_that_hangs_is_left(monkeypatch):
    monkeypatch.setattr(guard, "WAITING", 0.5)
    with pytest.raises(SweepError, match=r"takes more than 0\.5 s"):
        guarded(foreign_readers.hangs, b"", "it")


def test_a_process_starts_for_a_plausible_header_alone(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("ibrid.measurement.matlab.guarded", lambda *_: pytest.fail("a process was started"))
    for content in (b"x", b"time,value\n1,2\n", b"\x00" * 3, b"MATLAB 5.0".ljust(124) + b"\x00\x01XY" + bytes(50)):
        (tmp_path / "scan.mat").write_bytes(content)
        with pytest.raises(SweepError, match="must be a MAT file"):
            read_mat(tmp_path / "scan.mat")


def _mats() -> list[bytes]:
    savemat = pytest.importorskip("scipy.io").savemat
    rng = np.random.default_rng(0)
    variables = {"w": np.geomspace(10, 1e4, 16), "Y": rng.normal(size=(2, 2, 16)) + 1j, "p": 1.0, "q": 0.3, "op": "a"}
    files = []
    for options in ({"do_compression": True}, {}, {"format": "4"}):
        stream, kept = io.BytesIO(), dict(variables)
        if "format" in options:
            del kept["Y"]
        savemat(stream, kept, **options)
        files.append(stream.getvalue())
    return files


def _tried(folder: Path, number: int, seed: int) -> list[str]:
    """Reads mutated files; what was neither a sweep nor a sentence."""
    rng, files, wrong = random.Random(seed), _mats(), []
    for index in range(number):
        content = bytearray(files[index % len(files)])
        for _ in range(rng.randint(1, 8)):
            content[rng.randrange(len(content))] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        if rng.random() < 0.2:
            del content[rng.randrange(len(content)) :]
        path = folder / "scan.mat"
        path.write_bytes(content)
        try:
            read_mat(path)
        except SweepError as error:
            if len(str(error).splitlines()) != 1:
                wrong.append(f"{index}: {error}")
        except Exception as error:
            wrong.append(f"{index}: {type(error).__name__}: {error}")
    return wrong


def test_mutated_files_are_sweeps_or_sentences(tmp_path: Path):
    assert _tried(tmp_path, 6, seed=1) == []


def test_many_mutated_files_are_sweeps_or_sentences(tmp_path: Path):
    assert _tried(tmp_path, 150, seed=2) == []
