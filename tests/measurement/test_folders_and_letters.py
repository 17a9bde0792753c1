"""A folder in place of its files, letters of Chinese that are not in GB2312, MTB's names."""

import importlib.util

import numpy as np
import pytest

import ibrid
from ibrid.cli import main
from ibrid.measurement.formats.files import decoded
from ibrid.measurement.importing.timed.signal_names import signal_of


@pytest.mark.parametrize("called", ["scans", "my scans"])
def test_a_folder_names_the_command_that_reads_its_files(tmp_path, called):
    folder = tmp_path / called
    folder.mkdir()
    for name in ("a.csv", "b.csv", "b.csv.meta", "notes.txt", ".hidden"):
        (folder / name).write_text("f,Ydd\n1,2\n")
    quoted = f"'{folder}'" if " " in called else str(folder)
    with pytest.raises(ibrid.IbridError, match="must be a file; found a folder") as raised:
        ibrid.read_sweep(folder)
    assert f"or all at once: ibrid import {quoted}/*.csv --out read.csv." in str(raised.value)


def test_an_empty_folder_names_no_command(tmp_path):
    with pytest.raises(ibrid.IbridError, match=r"name one of the files in it\.$"):
        ibrid.read_sweep(tmp_path)


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_a_folder_without_a_name_of_its_own_is_no_sweep(folder, capsys):
    assert main(["inspect", folder]) == 2
    assert f"{folder} must be a file; found a folder" in capsys.readouterr().err


@pytest.mark.parametrize("words", ["频率,導纳实部 镕", "时间 (s),电压 喆", "頻率,電壓"])
def test_letters_of_chinese_beyond_gb2312_are_read(words):
    with pytest.raises(UnicodeEncodeError):
        words.encode("gb2312")
    assert decoded(words.encode("gbk")) == words


@pytest.mark.parametrize("words", ["Größe,Länge,Übergang", "fréquence,énergie réactive", "señal"])
def test_words_of_europe_are_none_of_chinese(words):
    assert decoded(words.encode("cp1252")) == words


def test_names_of_mtb_say_quantity_phase_and_unit():
    names = [r"MTB\P_pu_PoC", r"MTB\Q_pu_PoC", r"MTB\fft_pos_Vmag_pu", r"MTB\fft_pos_Id_pu"]
    read = [signal_of(name) for name in (*names, "s:ppoc_pu", "s:qpoc_pu")]
    assert {one.dimension for one in read} == {"per unit"}
    assert [one.quantity for one in read] == ["p", "q", "v", "i", "p", "q"]


def test_a_network_of_scikit_rf_in_siemens_is_its_admittance():
    skrf = pytest.importorskip("skrf")
    frequency = np.array([1.0, 10.0, 100.0])
    matrix = np.array([[[1 + k, 0.2j], [-0.2j, 1 - k * 1j]] for k in range(3)]) * 0.01
    network = skrf.Network(f=frequency, f_unit="hz", z0=50, y=matrix)
    keys = {"p": 0.8, "q": 0.1, "s_base_va": 10e3, "v_base_v": 400.0, "f0_hz": 50}
    (point,) = ibrid.read_sweep(network, **keys).points
    np.testing.assert_allclose(point.frequency, frequency)
    assert abs(point.admittance) == pytest.approx(abs(matrix) * 400**2 / 10e3)


class Labelled:
    """What of a DataArray of xarray is read."""

    def __init__(self, values, dims, coords, name="Y"):
        self.values, self.dims, self.coords = values, dims, coords
        self.name, self.attrs = name, {"p": 0.8, "q": 0.1}

    def transpose(self, *dims):
        order = [self.dims.index(axis) for axis in dims]
        return Labelled(self.values.transpose(order), dims, self.coords, self.name)

    def to_dataframe(self):
        raise AssertionError("a matrix is no column")


@pytest.mark.parametrize(
    ("dims", "order"),
    [
        (("freq", "row", "column"), (0, 1, 2)),
        (("output", "input", "freq"), (1, 2, 0)),
        (("freq", "input", "output"), (0, 2, 1)),
    ],
)
def test_a_matrix_with_named_axes_is_read_with_its_output_first(dims, order):
    numbers = np.random.default_rng(1).normal(size=(2, 5, 2, 2))
    matrix = numbers[0] + 1j * numbers[1]
    axis = Labelled(np.array([1.0, 3.0, 10.0, 40.0, 300.0]), (), {})
    labels = Labelled(np.array(["d", "q"]), (), {})
    coords = {"freq": axis, dims[1]: labels}
    said = {"unit": "pu", "f0_hz": 60, "current": "out", "q_axis": "leads", "voltage_axis": "d"}
    sweep = ibrid.read_sweep(Labelled(matrix.transpose(order), dims, coords), **said)
    np.testing.assert_allclose(sweep.points[0].admittance, matrix)
    assert (sweep.points[0].op.p, sweep.points[0].op.q) == (0.8, 0.1)


def test_a_matrix_whose_axes_name_q_first_is_refused():
    axis = Labelled(np.array([1.0, 3.0, 10.0]), (), {})
    labels = Labelled(np.array(["q", "d"]), (), {})
    coords = {"freq": axis, "row": labels}
    given = Labelled(np.ones((3, 2, 2)) * 1j, ("freq", "row", "column"), coords)
    with pytest.raises(ibrid.IbridError, match="must name d before q"):
        ibrid.read_sweep(given, unit="pu")


def test_a_package_that_is_missing_is_to_be_installed_and_nothing_saved_again(tmp_path):
    if importlib.util.find_spec("mhi"):
        pytest.skip("mhi-psout is installed")
    (tmp_path / "run.psout").write_bytes(b"\0" * 64)
    with pytest.raises(ibrid.IbridError, match=r"pip install mhi-psout .* or export csv\)\.$"):
        ibrid.read_events(tmp_path / "run.psout")
