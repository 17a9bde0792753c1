"""Binary files of others are read elsewhere: whatever a reader does there is one sentence here."""

import io
import sys
import zipfile
from pathlib import Path

import foreign_readers
import pytest
from ibrid_bench.attack.binaries import binaries_tried

from ibrid.errors import SweepError
from ibrid.measurement.formats import guarded as guard
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.importing.foreign_binary import hdf5_arrays, npz_arrays, workbook_cells
from ibrid.measurement.importing.matlab import read_mat

POSIX = pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is bounded on Linux alone for certain")


@pytest.mark.slow
def test_what_a_reader_finds_comes_back():
    held = guarded(foreign_readers.plain, b"\x01\x02", "it")
    assert held["x"].tolist() == [1, 2]
    assert held["word"].item() == "abc"


@pytest.mark.slow
def test_what_a_reader_does_at_the_end_of_its_process_takes_nothing_from_what_it_read():
    assert guarded(foreign_readers.ends_badly, b"\x01", "it")["x"].tolist() == [1]


@pytest.mark.nightly
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


def test_numbers_that_an_hdf5_file_keeps_elsewhere_are_not_read(tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(bytes(64))
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        file.create_dataset("f", (8,), "f8", external=[(str(tmp_path / "secret"), 0, 64)])
    layout = h5py.VirtualLayout((8,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "f", (8,))
    with h5py.File(tmp_path / "parts.h5", "w") as file:
        file.create_virtual_dataset("f", layout)
    for name in ("scan.h5", "parts.h5"):
        with pytest.raises(ValueError, match="f keeps its numbers in another file, which is not opened"):
            hdf5_arrays((tmp_path / name).read_bytes())


def test_a_member_of_an_npz_file_that_is_no_array_is_named():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr("readme.txt", "no array")
    with pytest.raises(ValueError, match=r"readme.txt in it is no array of NumPy"):
        npz_arrays(stream.getvalue())
    with zipfile.ZipFile(stream, "w") as file:
        header = b"{'descr': 1+1, 'fortran_order': False, 'shape': (1,)}\n"
        file.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(ValueError, match="the header of an array is damaged"):
        npz_arrays(stream.getvalue())


def test_a_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    with pytest.raises(ImportError, match=r"install python_calamine for it, pip install 'ibrid\[tables\]'"):
        workbook_cells(b"")


@pytest.mark.slow
def test_a_reader_that_hangs_is_left(monkeypatch):
    monkeypatch.setattr(guard, "STILL", 100)
    with pytest.raises(SweepError, match="reading it did nothing in 100 looks"):
        guarded(foreign_readers.hangs, b"", "it")


def test_a_process_starts_for_a_plausible_header_alone(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("ibrid.measurement.importing.matlab.guarded", lambda *_: pytest.fail("a process was started"))
    for content in (b"x", b"time,value\n1,2\n", b"\x00" * 3, b"MATLAB 5.0".ljust(124) + b"\x00\x01XY" + bytes(50)):
        (tmp_path / "scan.mat").write_bytes(content)
        with pytest.raises(SweepError, match="must be a MAT file"):
            read_mat(tmp_path / "scan.mat")


@pytest.mark.nightly
def test_mutated_files_are_sweeps_or_sentences(tmp_path: Path):
    assert list(binaries_tried(tmp_path, 6, seed=1)) == []


@pytest.mark.nightly
def test_many_mutated_files_are_sweeps_or_sentences(tmp_path: Path):
    assert list(binaries_tried(tmp_path, 150, seed=2)) == []
