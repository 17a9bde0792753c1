"""Tables whose names, attributes or rows say more than their numbers: what would change the
meaning is refused or said.
"""

import h5py
import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.importing.importing import Imported, import_files
from ibrid.measurement.quality.wrong_rows import NO_NUMBERS, NOT_MEASURED, wrong_rows

FREQUENCY = np.geomspace(1.0, 1000.0, 12)
MATRIX = np.array([[-1 + 0.25j, 0.125 - 0.5j], [0.0625, 1.5 - 2.375j]]) / (
    1 + FREQUENCY[:, None, None] / 100j
)
SAID = {"unit": "pu", "f0_hz": 60.0, "current": "out", "q_axis": "leads", "voltage_axis": "d"}
POWERS = {"p": 0.8, "q": 0.1}
ENTRIES = ("dd", "dq", "qd", "qq")


def text(frequency="f", frame="dq", at=FREQUENCY, matrix=MATRIX) -> str:
    """A table with real and imaginary parts of four entries."""
    entries = {"dq": ENTRIES, "pn": ("pp", "pn", "np", "nn")}[frame]
    names = [f"Y{entry}_{part}" for entry in entries for part in ("re", "im")]
    rows = [
        ",".join(map(repr, [float(f), *one.ravel().view(float).tolist()]))
        for f, one in zip(at, matrix, strict=True)
    ]
    return "\n".join([",".join([frequency, *names]), *rows]) + "\n"


def of_text(tmp_path, content: str, maps=(), **said) -> Imported:
    path = tmp_path / "table.csv"
    path.write_text(content)
    return import_files([path], maps, **SAID, **said)


@pytest.mark.parametrize("name", ["f_network", "network_frequency [Hz]", "omega_network"])
def test_dq_entries_at_frequencies_of_the_network_are_refused(tmp_path, name):
    with pytest.raises(SweepError, match="by its name that of the network") as refused:
        of_text(tmp_path, text(name, at=FREQUENCY + 60), **POWERS)
    option = str(refused.value).partition("--map ")[2].partition(" if")[0]
    taken = of_text(tmp_path, text(name, at=FREQUENCY + 60), [option], **POWERS).sweep
    turns = 2 * np.pi if option.startswith("omega") else 1.0
    assert np.allclose(taken.points[0].frequency, (FREQUENCY + 60) / turns)


def test_sequence_entries_at_frequencies_of_the_network_are_read(tmp_path):
    """Law: the dq frequency is that of the network less f0."""
    sweep = of_text(tmp_path, text("f_network", "pn", FREQUENCY + 60), **POWERS).sweep
    assert np.allclose(sweep.points[0].frequency, FREQUENCY)


def of_hdf5(path, key, number) -> Imported:
    """What is made of an HDF5 file in which each entry has an attribute."""
    with h5py.File(path, "w") as file:
        file["f"] = FREQUENCY
        for name, column in zip(ENTRIES, MATRIX.reshape(-1, 4).T, strict=True):
            file[f"Y{name}"] = column
            file[f"Y{name}"].attrs[key] = number
    return import_files([path], **SAID, **POWERS)


@pytest.mark.parametrize(
    ("key", "number"),
    [
        ("scale", 1e-3),
        ("Gain", 2.0),
        ("factor", np.int32(5)),
        ("multiplier", [0.5]),
        ("Scale Factor", 0.5),
        ("offset", 1.0),
    ],
)
def test_factors_and_offsets_of_no_convention_are_refused(tmp_path, key, number):
    with pytest.raises(SweepError, match=f"attribute {key} = .*call it .* or leave it out") as said:
        of_hdf5(tmp_path / "scan.h5", key, number)
    named = str(said.value).partition("call it ")[2].partition(",")[0]
    taken = of_hdf5(tmp_path / "scan.h5", named, number).sweep
    value = np.ravel(number)[0]
    packed = MATRIX + value if named == "add_offset" else MATRIX * value
    assert np.allclose(taken.points[0].admittance, packed)


def test_factors_and_offsets_that_change_nothing_are_no_matter(tmp_path):
    for key, number in (("scale", 1.0), ("gain", 1), ("offset", 0.0), ("scale", "linear")):
        taken = of_hdf5(tmp_path / "scan.h5", key, number).sweep
        assert np.allclose(taken.points[0].admittance, MATRIX)


def remarks_of_files(tmp_path, **files) -> list[str]:
    """What is remarked on files of one p and q each, of which the sweep has an operating point."""
    paths = [tmp_path / f"{name}_P1_Q0.3.csv" for name in files]
    for path, matrix in zip(paths, files.values(), strict=True):
        path.write_text(text(matrix=matrix))
    taken = import_files(paths, **SAID)
    assert len(taken.sweep.points) == len(files)
    return [one for one in taken.remarks if "have the same" in one]


def test_points_with_one_steady_state_and_other_matrices_are_said(tmp_path):
    (said,) = remarks_of_files(tmp_path, a=MATRIX, b=1.25 * MATRIX)
    assert said.startswith("a_P1_Q0.3, b_P1_Q0.3 have the same p, q and v, but differ by 25 %")


def test_the_same_table_twice_is_said(tmp_path):
    (said,) = remarks_of_files(tmp_path, a=MATRIX, b=MATRIX)
    assert said.startswith("a_P1_Q0.3, b_P1_Q0.3 have the same numbers")
    both = remarks_of_files(tmp_path, a=MATRIX, b=MATRIX, c=2 * MATRIX)
    assert [one.partition(" have")[0] for one in both] == [
        "a_P1_Q0.3, b_P1_Q0.3",
        "a_P1_Q0.3, c_P1_Q0.3",
    ]
    assert remarks_of_files(tmp_path, a=MATRIX) == []


@pytest.mark.parametrize("number", [1e30, 9.96920996838687e36, 1e20, -999.0, 9999.0])
def test_rows_of_a_number_for_nothing_measured_are_said_and_kept(tmp_path, number):
    matrix = MATRIX.copy()
    matrix[4] = number * (1 + 1j)
    taken = of_text(tmp_path, text(matrix=matrix), **POWERS)
    (said,) = [one for one in taken.remarks if "in all entries" in one]
    assert f"(line 6) with {number:g} in all entries" in said
    (point,) = taken.sweep.points
    assert len(point.frequency) == len(FREQUENCY)
    assert [(row.frequency, row.likely) for row in wrong_rows(point)] == [
        (FREQUENCY[4], NOT_MEASURED)
    ]


def test_rows_of_zeros_are_named_beside_those_of_huge_numbers(tmp_path):
    matrix = MATRIX.copy()
    matrix[4], matrix[7] = 1e30, 0.0
    taken = of_text(tmp_path, text(matrix=matrix), **POWERS)
    found = [(row.frequency, row.likely) for row in wrong_rows(taken.sweep.points[0])]
    assert found == [(FREQUENCY[4], NOT_MEASURED), (FREQUENCY[7], NO_NUMBERS)]


def test_large_entries_of_their_own_are_no_fill_values(tmp_path):
    """A small unit makes all numbers large, and no row has one number alone."""
    taken = of_text(tmp_path, text(matrix=999 * MATRIX), **POWERS)
    assert not [one for one in taken.remarks if "in all entries" in one]
    assert wrong_rows(taken.sweep.points[0]) == ()
