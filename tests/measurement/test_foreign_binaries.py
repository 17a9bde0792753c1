"""Binary files of others are read elsewhere: whatever a reader does there is one sentence here."""

import io
import sys
import zipfile
from pathlib import Path

import foreign_readers
import numpy as np
import pytest
from ibrid_bench.attack.binaries import binaries_tried

from ibrid.errors import SweepError
from ibrid.measurement.formats import guarded as guard
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.importing.binary.foreign_binary import (
    json_cells,
    npz_arrays,
    parquet_cells,
    workbook_cells,
)
from ibrid.measurement.importing.binary.hdf5_file import hdf5_arrays
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.matlab import read_mat

POSIX = pytest.mark.skipif(
    sys.platform != "linux", reason="memory of a process is bounded on Linux alone for certain"
)


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
        with pytest.raises(
            ValueError, match="f keeps its numbers in another file, which is not opened"
        ):
            hdf5_arrays((tmp_path / name).read_bytes())


def made_by(writer, tmp_path: Path):
    """The arrays of an HDF5 file that a function fills."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        writer(file, h5py)
    return hdf5_arrays((tmp_path / "scan.h5").read_bytes())


def test_numbers_that_netcdf_packs_are_unpacked_and_missing_ones_empty(tmp_path: Path):
    def write(file, h5py):
        file["Ydd"] = np.array([-3, 5, -32767, 7, 9], "i2")
        file["Ydd"].attrs.update(
            {"scale_factor": 0.5, "add_offset": 10.0, "_FillValue": np.int16(-32767)}
        )
        file["f"] = np.array([1, 9.96921e36, -99.9], "f4")
        file["f"].attrs["missing_value"] = [-99.9, 9.96921e36]
        file["Y"] = np.array([[2 + 4j]])
        file["Y"].attrs["scale_factor"] = np.array([0.5])

    arrays = made_by(write, tmp_path)
    np.testing.assert_array_equal(arrays["Ydd"], [8.5, 12.5, np.nan, 13.5, 14.5])
    np.testing.assert_array_equal(arrays["f"], [1, np.nan, np.nan])
    assert arrays["Y"] == [[1 + 2j]]
    assert list(arrays) == ["Y", "Ydd", "f"]

    def write_many(file, h5py):
        file["Ydd"] = [1, 2]
        file["Ydd"].attrs["scale_factor"] = [1.0, 2.0]

    with pytest.raises(ValueError, match="scale_factor of Ydd is not a single number"):
        made_by(write_many, tmp_path)


@pytest.mark.parametrize(
    ("bounds", "left"),
    [
        ({"valid_range": np.array([0, 100], "i2")}, [10.0, np.nan, 20.0, 60.0]),
        ({"valid_min": np.int16(0)}, [10.0, np.nan, 20.0, 60.0]),
        ({"valid_max": np.array([20], "i2")}, [10.0, 5.0, 20.0, np.nan]),
        ({"valid_range": [5.0, 40.0]}, [10.0, 5.0, 20.0, np.nan]),
        ({"valid_max": 15.0, "_FillValue": np.int16(0)}, [np.nan, 5.0, np.nan, np.nan]),
    ],
)
def test_numbers_beyond_the_valid_range_of_netcdf_are_empty(
    tmp_path: Path, bounds: dict, left: list
):
    def write(file, h5py):
        file["Ydd"] = np.array([0, -10, 20, 100], "i2")
        file["Ydd"].attrs.update({"scale_factor": 0.5, "add_offset": 10.0, **bounds})

    arrays = made_by(write, tmp_path)
    assert list(arrays) == ["Ydd"]
    np.testing.assert_array_equal(arrays["Ydd"], left)


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        ({"valid_range": [1.0]}, "valid_range of Ydd is not two numbers"),
        ({"valid_max": "much"}, "valid_max of Ydd is not a single number"),
    ],
)
def test_a_valid_range_of_another_form_is_refused(tmp_path: Path, bounds: dict, words: str):
    def write(file, h5py):
        file["Ydd"] = [1.0, 2.0]
        file["Ydd"].attrs.update(bounds)

    with pytest.raises(ValueError, match=words):
        made_by(write, tmp_path)


def test_whole_numbers_that_netcdf_calls_unsigned_have_no_sign(tmp_path: Path):
    def write(file, h5py):
        file["Ydd"] = np.array([1, -2, -1], "i1")
        file["Ydd"].attrs.update({"_Unsigned": "true", "_FillValue": np.int8(-1)})

    np.testing.assert_array_equal(made_by(write, tmp_path)["Ydd"], [1, 254, np.nan])


def test_dimension_scales_and_units_in_arrays_are_read(tmp_path: Path):
    def write(file, h5py):
        file["w"] = [1.0, 2.0, 4.0]
        file["w"].attrs["units"] = np.array(["rad/s"], dtype=h5py.string_dtype())
        file["Y"] = [1.0, 2.0, 3.0]
        file["w"].make_scale("w")
        file["Y"].dims[0].attach_scale(file["w"])
        file["row"] = np.zeros(3)
        file["row"].make_scale("This is a netCDF dimension but not a netCDF variable.         3")

    assert list(made_by(write, tmp_path)) == ["Y", "w [rad/s]"]


#: Three matrices [[1, 2], [3, 4]] and so on, of which none is symmetric.
STACK = np.arange(1.0, 13.0).reshape(3, 2, 2)


def labelled(labels, stack, scales: bool = False, entries=None):
    """A writer of the stack as Y whose axes are called so, by labels or by scales, with texts for
    the entries of one.
    """

    def write(file, h5py):
        file["Y"] = stack
        for axis, label in enumerate(labels):
            if scales:
                file[label] = (
                    entries if entries and label != "frequency" else np.arange(stack.shape[axis])
                )
                file[label].make_scale(label)
                file["Y"].dims[axis].attach_scale(file[label])
            else:
                file["Y"].dims[axis].label = label

    return write


@pytest.mark.parametrize("scales", [False, True])
@pytest.mark.parametrize(
    ("labels", "order"),
    [
        (("frequency", "output", "input"), (0, 1, 2)),
        (("frequency", "input", "output"), (0, 2, 1)),
        (("frequency", "Columns", "Rows"), (0, 2, 1)),
        (("InputAxis", "OutputAxis", "frequency"), (2, 1, 0)),
        (("output_current", "input_voltage", "frequency"), (1, 2, 0)),
        (("input", "frequency", "out"), (2, 0, 1)),
        (("frequency", "from", "x"), (0, 2, 1)),
        (("frequency", "i", "j"), (0, 1, 2)),
        (("frequency", "j", "i"), (0, 2, 1)),
        (("frequency", "u", "y"), (0, 2, 1)),
        (("frequency", "eingang", "ausgang"), (0, 2, 1)),
        (("frequency", "Spalten", "Zeilen"), (0, 2, 1)),
        (("frequency", "cause", "effect"), (0, 2, 1)),
        (("frequency", "entrée", "sortie"), (0, 2, 1)),
        (("frequency", "phony_dim_1", "phony_dim_2"), (0, 1, 2)),
    ],
)
def test_axes_of_hdf5_that_say_input_before_output_are_exchanged(
    tmp_path: Path, labels, order, scales: bool
):
    read = made_by(labelled(labels, STACK.transpose(order), scales), tmp_path)["Y"]
    frequencies = read.shape.index(3)
    np.testing.assert_array_equal(np.moveaxis(read, frequencies, 0), STACK)


def test_axes_of_hdf5_that_tell_no_order_or_another_one_are_refused(tmp_path: Path):
    with pytest.raises(
        ValueError, match="the axes of Y are called voltage and current, call them output and input"
    ):
        made_by(labelled(("frequency", "voltage", "current"), STACK), tmp_path)
    for names in (("v", "i"), ("alpha", "beta")):
        with pytest.raises(ValueError, match=f"called {names[0]} and {names[1]}, call them output"):
            made_by(labelled(("frequency", *names), STACK), tmp_path)
    with pytest.raises(ValueError, match="the axis output of Y names q before d"):
        made_by(labelled(("frequency", "output"), STACK, True, ["iq", "id"]), tmp_path)


def test_an_array_whose_first_index_runs_fastest_must_name_its_axes(tmp_path: Path):
    def write(names):
        def of(file, h5py):
            labelled(names, STACK)(file, h5py)
            file["Y"].attrs["order"] = "F"

        return of

    with pytest.raises(ValueError, match="order of Y says that the first index runs fastest"):
        made_by(write(()), tmp_path)
    named = made_by(write(("frequency", "input", "output")), tmp_path)["Y"]
    np.testing.assert_array_equal(named, STACK.transpose(0, 2, 1))


def test_files_of_julia_have_their_first_index_running_fastest(tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "scan.jld2"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["Y"] = STACK.T
    content = bytearray(path.read_bytes())
    words = b"HDF5-based Julia Data Format, version 0.2.0\0"
    content[: len(words)] = words
    np.testing.assert_array_equal(hdf5_arrays(bytes(content))["Y"], STACK)


@pytest.mark.parametrize("parts", [("re", "im"), ("r", "i"), ("real", "imag")])
def test_pairs_of_parts_are_complex_numbers(tmp_path: Path, parts: tuple[str, str]):
    pairs = np.array([(1, 2), (3, -4)], dtype=[(part, "f8") for part in parts])
    arrays = made_by(lambda file, h5py: file.create_dataset("Y", data=pairs), tmp_path)
    assert arrays["Y"].tolist() == [1 + 2j, 3 - 4j]


def test_a_table_of_hdf5_is_read_by_the_names_of_its_fields(tmp_path: Path):
    fields = [
        ("op", "S4"),
        ("freq_hz", "<f4"),
        ("Y", [("r", "f8"), ("i", "f8")]),
        ("values", "f8", (2,)),
    ]
    rows = np.array([(b"full", 1.0, (1, 2), (5, 6)), (b"half", 2.0, (3, -4), (7, 8))], dtype=fields)
    arrays = made_by(lambda file, h5py: file.create_dataset("scan/table", data=rows), tmp_path)
    held = {name.removeprefix("scan.table."): value.tolist() for name, value in arrays.items()}
    values = [[5, 6], [7, 8]]
    assert held == {
        "op": ["full", "half"],
        "freq_hz": [1, 2],
        "Y": [1 + 2j, 3 - 4j],
        "values": values,
    }


@pytest.mark.slow
def test_operating_points_of_a_table_of_hdf5_are_told_apart(tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    names = ["op", "p", "q", "freq", *(f"Y{entry}" for entry in ("dd", "dq", "qd", "qq"))]
    kinds = ["S4", *["f8"] * 3, *["c16"] * 4]
    rows = [
        (b"half" if p < 1 else b"full", p, 0.1, f, *f * SCAN[0].ravel())
        for p in (1, 0.5)
        for f in (2.0, 5.0)
    ]
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        file["table"] = np.array(rows, dtype=[*zip(names, kinds, strict=True)])
    options = {key: value for key, value in SCANNED.items() if key not in "pq"}
    sweep = import_files([tmp_path / "scan.h5"], **options).answered()
    assert {point.op.name: (point.op.p, point.op.q) for point in sweep.points} == {
        "full": (1, 0.1),
        "half": (0.5, 0.1),
    }
    np.testing.assert_array_equal(
        sweep.points[1].admittance, np.multiply.outer([2.0, 5.0], SCAN[0])
    )


def test_cells_and_structures_of_matlab_73_are_read_as_those_before(tmp_path: Path):
    def write(file, h5py):
        def put(place, name, value, matlab=b"double"):
            place[name] = value
            if matlab:
                place[name].attrs["MATLAB_class"] = np.bytes_(matlab)
            return place[name].ref

        def refer(*values):
            return [put(file, f"#refs#/{len(file['#refs#'])}", value) for value in values]

        file.create_group("#refs#")
        cells = np.array(
            refer(*(entry[None] for entry in SCAN.reshape(3, 4).real.T)), dtype=h5py.ref_dtype
        )
        put(file, "Y", cells.reshape(2, 2).T, b"cell")
        scans = file.create_group("scan")
        scans.attrs["MATLAB_class"] = np.bytes_("struct")
        put(scans, "p", np.array([refer([[0.5]], [[1.0]])], dtype=h5py.ref_dtype), b"")
        inner = file.create_group("#refs#/inner")
        put(inner, "q", [[0.1]])
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
        put(file, "more", np.array([[inner.ref, *refer([[3.0]])]], dtype=h5py.ref_dtype), b"cell")
        put(file, "none", np.zeros(2, "u8"))
        file["none"].attrs["MATLAB_empty"] = np.uint8(1)

    arrays = made_by(write, tmp_path)
    np.testing.assert_array_equal(arrays.pop("Y"), np.moveaxis(SCAN.real, 0, -1))
    single = {name: value.item() for name, value in arrays.items()}
    assert single == {"more(1).q": 0.1, "more{2}": 3, "scan(1).p": 0.5, "scan(2).p": 1}


@pytest.mark.parametrize("through_a_structure", [False, True])
def test_cells_that_hold_themselves_are_refused(tmp_path: Path, through_a_structure: bool):
    def write(file, h5py):
        file.create_dataset("Y", (1, 1), h5py.ref_dtype)
        file["Y"].attrs["MATLAB_class"] = np.bytes_("cell")
        held = file.create_group("#refs#/again")
        held["inner"] = held
        file["Y"][0, 0] = held.ref if through_a_structure else file["Y"].ref

    with pytest.raises(ValueError, match="Y has cells more than 32 deep in each other"):
        made_by(write, tmp_path)


def test_soft_links_within_a_file_are_read_and_others_refused(tmp_path: Path):
    def linked(**links):
        def write(file, h5py):
            file["scan/x"] = [1, 2, 3]
            for name, link in links.items():
                file[f"scan/{name}"] = link

        return made_by(write, tmp_path)

    h5py = pytest.importorskip("h5py")
    assert linked(Y=h5py.SoftLink("/scan/x"), Z=h5py.SoftLink("x"))["scan.Y"].tolist() == [1, 2, 3]
    with pytest.raises(ValueError, match="scan/Y is a link to scan/none, which is not there"):
        linked(Y=h5py.SoftLink("none"))
    with pytest.raises(ValueError, match="scan/Y keeps its numbers in another file"):
        linked(Y=h5py.ExternalLink("other.h5", "/Y"))


def test_an_array_put_together_of_others_in_the_file_is_said_as_that(tmp_path: Path):
    def write(file, h5py):
        file["x"] = np.arange(8.0)
        layout = h5py.VirtualLayout((8,), "f8")
        layout[:] = h5py.VirtualSource(".", "x", (8,))
        file.create_virtual_dataset("f", layout)

    with pytest.raises(ValueError, match="f is put together of other arrays"):
        made_by(write, tmp_path)


def test_every_name_of_any_record_is_a_column():
    cells = json_cells(b'[{"f": 1, "v": 2}, {"f": 2, "sigma": 0.5}]')["table"]
    assert cells.tolist() == [["f", "v", "sigma"], ["1", "2", ""], ["2", "", "0.5"]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "it holds no list"),
        ("{}", "it holds no list"),
        ("5", "it is a single value"),
        ("null", "it is a single value"),
        ("[1, 2]", "element 1 of its list must be an object with names"),
        ('[{"f": 1}, 5]', "element 2 of its list must be an object with names"),
        ('{"a": [1], "b": [1, 2]}', "it holds lists of 1 and 2 cells, must be equally long"),
        ('{"data": [{"f": 1}]}', "'data' must hold numbers or texts, found lists or objects in it"),
        ('[{"f": 1, "f": 2}]', "the name 'f' stands twice"),
    ],
)
def test_json_of_another_shape_is_named(text: str, words: str):
    with pytest.raises(ValueError, match=words):
        json_cells(text.encode())


def test_the_unit_of_a_column_of_parquet_is_read():
    parquet, arrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    fields = [
        arrow.field("w", "f8", metadata={"unit": "rad/s"}),
        arrow.field("Ydd", "f8", metadata={"origin": "x"}),
    ]
    table, stream = (
        arrow.table({"w": [1.0], "Ydd": [2.0]}, schema=arrow.schema(fields)),
        io.BytesIO(),
    )
    parquet.write_table(table, stream)
    assert parquet_cells(stream.getvalue())["table"].tolist() == [
        ["w [rad/s]", "Ydd"],
        ["1.0", "2.0"],
    ]


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
    with pytest.raises(
        ImportError, match=r"install python_calamine for it, pip install 'ibrid\[tables\]'"
    ):
        workbook_cells(b"")


@pytest.mark.slow
def test_a_reader_that_hangs_is_left(monkeypatch):
    monkeypatch.setattr(guard, "STILL", 100)
    with pytest.raises(SweepError, match="reading it did nothing in 100 looks"):
        guarded(foreign_readers.hangs, b"", "it")


def test_a_process_starts_for_a_plausible_header_alone(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(
        "ibrid.measurement.importing.matlab.guarded",
        lambda *_: pytest.fail("a process was started"),
    )
    for content in (
        b"x",
        b"time,value\n1,2\n",
        b"\x00" * 3,
        b"MATLAB 5.0".ljust(124) + b"\x00\x01XY" + bytes(50),
    ):
        (tmp_path / "scan.mat").write_bytes(content)
        with pytest.raises(SweepError, match="must be a MAT file"):
            read_mat(tmp_path / "scan.mat")


@pytest.mark.nightly
def test_mutated_files_are_sweeps_or_sentences(tmp_path: Path):
    assert list(binaries_tried(tmp_path, 6, seed=1)) == []


@pytest.mark.nightly
def test_many_mutated_files_are_sweeps_or_sentences(tmp_path: Path):
    assert list(binaries_tried(tmp_path, 150, seed=2)) == []


def mat_file(path: Path, **variables: object) -> Path:
    """A MAT file of version 5; lists of arrays, or lists of lists, are cell arrays."""
    from scipy.io import savemat

    def cells(held: list) -> np.ndarray:
        rows = held if isinstance(held[0], list) else [held]
        made = np.empty((len(rows), len(rows[0])), dtype=object)
        for row, column in np.ndindex(*made.shape):
            made[row, column] = rows[row][column]
        return made

    savemat(
        path,
        {name: cells(one) if isinstance(one, list) else one for name, one in variables.items()},
    )
    return path


SCAN = np.arange(1, 13).reshape(3, 2, 2) * (1 + 0.5j)
SCANNED = {
    "unit": "pu",
    "f0_hz": 50.0,
    "current": "out",
    "q_axis": "leads",
    "voltage_axis": "d",
    "p": 0.0,
    "q": 0.0,
}


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("inside", [False, True])
def test_a_cell_array_of_the_four_entries_is_the_matrix(tmp_path: Path, inside: bool, count: int):
    scan, frequency = SCAN[:count], np.array([1.0, 2.0, 5.0])[:count]
    Y = [[scan[:, row, column] for column in range(2)] for row in range(2)]
    path = mat_file(tmp_path / "cells.mat", f=frequency, Y=Y)
    if inside:
        held = np.empty((2, 2), dtype=object)
        for row, column in np.ndindex(2, 2):
            held[row, column] = Y[row][column]
        path = mat_file(tmp_path / "struct.mat", scan={"f": frequency, "Y": held})
    (point,) = import_files([path], **SCANNED).answered().points
    np.testing.assert_array_equal(point.frequency, frequency)
    np.testing.assert_array_equal(point.admittance, scan)


@pytest.mark.slow
def test_a_cell_for_each_frequency_is_its_matrix(tmp_path: Path):
    path = mat_file(tmp_path / "cells.mat", f=np.array([1.0, 2.0, 5.0]), Y=[*SCAN])
    np.testing.assert_array_equal(
        import_files([path], **SCANNED).answered().points[0].admittance, SCAN
    )


@pytest.mark.slow
def test_a_cell_array_of_another_form_is_refused_with_those_that_are_read(tmp_path: Path):
    dd, dq, qd, qq = SCAN.reshape(3, 4).T
    forms = {
        "row": [dd, dq, qd, qq],
        "two": [[dd, dq]],
        "text": [[dd, "of dq"], [qd, qq]],
        "short": [[dd, dq], [qd, qq[:2]]],
    }
    for name, cells in forms.items():
        path = mat_file(tmp_path / f"{name}.mat", f=np.array([1.0, 2.0, 5.0]), Y=cells)
        with pytest.raises(SweepError, match="a cell array be 2 x 2 of K numbers each"):
            import_files([path], **SCANNED)
    named = import_files(
        [tmp_path / "row.mat"], ["Ydd=Y{1},Ydq=Y{2},Yqd=Y{3},Yqq=Y{4}"], **SCANNED
    ).answered()
    np.testing.assert_array_equal(named.points[0].admittance, SCAN)


def test_groups_that_lie_deep_in_each_other_are_refused_at_once(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "deep.h5", "w") as file:
        file["/".join(["g"] * 400 + ["f"])] = np.arange(5.0)
    with pytest.raises(ValueError, match="more than 32 deep"):
        hdf5_arrays((tmp_path / "deep.h5").read_bytes())
