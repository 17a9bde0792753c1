"""Both parts of an entry count in their own unit: real and imaginary, magnitude and phase."""

from pathlib import Path

import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.importing.foreign_table import array_table
from ibrid.measurement.importing.importing import Imported, import_tables
from ibrid.measurement.importing.table_files import read_tables

ENTRIES = ("dd", "dq", "qd", "qq")
SAID = {
    "base": "10kVA,400V",
    "f0_hz": 50.0,
    "current": "out",
    "q_axis": "leads",
    "voltage_axis": "d",
    "p": 0.0,
    "q": 0.0,
    "quantity": "Y",
}
FREQUENCY = np.array([1.0, 2.0, 4.0])
#: S; its real part is printed in the first unit of a test and its imaginary part in the second.
ADMITTANCE = np.array([1.0, 2.0, 4.0])[:, None, None] * np.array(
    [[-1 + 0.1j, 0.3 + 0.2j], [0.3 + 0.1j, 1 + 0.1j]]
)
#: Siemens of one per unit.
BASE_S = 10e3 / 400**2


def columns(first: str, second: str, sizes=(1.0, 1.0), parts=("re", "im")) -> dict[str, np.ndarray]:
    """A table of ADMITTANCE, whose names have some words behind them, with each part times a
    size.
    """
    table = {"f": FREQUENCY}
    for entry, values in zip(ENTRIES, ADMITTANCE.reshape(-1, 4).T, strict=True):
        pair = (
            (values.real, values.imag) if parts[0] == "re" else (np.abs(values), np.angle(values))
        )
        for part, words, size, numbers in zip(parts, (first, second), sizes, pair, strict=True):
            table[f"Y{entry}_{part}{words}"] = numbers * size
    return table


def imported(table: dict[str, np.ndarray], *maps: str, **said: object) -> Imported:
    return import_tables([array_table(table, "scan.csv", "scan")], maps, **{**SAID, **said})


def read(table: dict[str, np.ndarray], *maps: str, **said: object) -> np.ndarray:
    return imported(table, *maps, **said).answered().points[0].admittance * BASE_S


@pytest.mark.parametrize(
    ("first", "second", "sizes"),
    [
        (" [mS]", " [S]", (1e3, 1.0)),
        (" [S]", " [mS]", (1.0, 1e3)),
        (" (kA/kV)", " [uS]", (1.0, 1e6)),
        (" [mS]", "", (1e3, 1e3)),
        ("", " [mS]", (1e3, 1e3)),
    ],
)
def test_each_part_of_an_entry_counts_in_its_own_unit(
    first: str, second: str, sizes: tuple[float, float]
):
    np.testing.assert_allclose(read(columns(first, second, sizes)), ADMITTANCE, rtol=1e-12)


def test_parts_in_percent_and_per_unit_agree():
    table = columns(" [%]", " [pu]", (100 / BASE_S, 1 / BASE_S))
    np.testing.assert_allclose(read(table), ADMITTANCE, rtol=1e-12)


@pytest.mark.parametrize("units", [("S", "pu"), ("pu", "S"), ("S", "ohm"), ("mS", "deg")])
def test_parts_in_units_of_two_kinds_are_refused_by_name(units: tuple[str, str]):
    words = rf"^scan.csv: both parts .* found Ydd_re \[{units[0]}\] in {units[0]} beside Ydd_im \[{units[1]}\] in {units[1]}, "
    with pytest.raises(SweepError, match=words):
        imported(columns(f" [{units[0]}]", f" [{units[1]}]"))


def mapped(first: str, mark: str, second: str) -> str:
    pairs = (
        f"Y{entry}=#{2 * k + 2}{first}{mark}#{2 * k + 3}{second}" for k, entry in enumerate(ENTRIES)
    )
    return ",".join(pairs)


def test_the_map_says_the_unit_of_each_part_or_of_both():
    for first, second, sizes in (
        ("[mS]", "[S]", (1e3, 1.0)),
        ("", "[mS]", (1e3, 1e3)),
        ("[mS]", "", (1e3, 1e3)),
    ):
        found = read(columns("", "", sizes), mapped(first, "+j", second))
        np.testing.assert_allclose(found, ADMITTANCE, rtol=1e-12)
    named = columns(" [S]", " [mS]", (1e3, 1.0))  # names that are wrong, which the map puts right
    np.testing.assert_allclose(read(named, mapped("[mS]", "+j", "[S]")), ADMITTANCE, rtol=1e-12)
    with pytest.raises(SweepError, match=r"found Ydd_re in S beside Ydd_im in pu"):
        imported(columns("", ""), mapped("[S]", "+j", "[pu]"))


def test_one_unit_in_the_map_beside_another_in_a_name_is_refused():
    with pytest.raises(
        SweepError, match=r"found \[mS\] once, while a name says \[S\], write one behind each"
    ):
        imported(columns("", " [S]"), mapped("[mS]", "+j", ""))


def test_a_phase_counts_in_its_own_unit_and_must_be_an_angle():
    sizes = {" [rad]": 1.0, " [mrad]": 1e3, " [deg]": 180 / np.pi}
    for unit, size in sizes.items():
        table = columns(" [mS]", unit, (1e3, size), ("mag", "phase"))
        np.testing.assert_allclose(read(table), ADMITTANCE, rtol=1e-12)
    with pytest.raises(
        SweepError, match=r"Ydd_phase \[S\] must be a phase in deg or rad; found \[S\]"
    ):
        imported(columns(" [mS]", " [S]", parts=("mag", "phase")))
    with pytest.raises(SweepError, match=r"Ydd_phase must be a phase in deg or rad; found \[S\]"):
        imported(columns("", "", parts=("mag", "phase")), mapped("[mS]", "@", "[S]"))


@pytest.mark.parametrize(("unit", "size"), [("", 1e3), (" [mS]", 1e3), (" [S]", 1.0)])
def test_a_standard_deviation_counts_in_its_own_unit(unit: str, size: float):
    table = columns(" [mS]", " [mS]", (1e3, 1e3)) | {f"sigma{unit}": 0.01 * FREQUENCY * size}
    sigma = imported(table).answered().points[0].sigma
    assert sigma is not None
    np.testing.assert_allclose(sigma[:, 0, 0] * BASE_S, 0.01 * FREQUENCY, rtol=1e-12)
    with pytest.raises(
        SweepError, match=r"sigma \[pu\] must be in the unit of the matrix, mS; found pu"
    ):
        imported(columns(" [mS]", " [mS]") | {"sigma [pu]": FREQUENCY})


@pytest.mark.parametrize(
    ("unit", "of_sigma"), [("pu", "%"), ("pu", "dB"), ("dB", "dB"), ("dB", ""), ("mS", "%")]
)
def test_a_standard_deviation_that_may_be_relative_is_refused(unit: str, of_sigma: str):
    parts = ("mag", "phase") if unit == "dB" else ("re", "im")
    table = columns(f" [{unit}]", " [deg]" if unit == "dB" else f" [{unit}]", parts=parts)
    name = f"sigma [{of_sigma}]" if of_sigma else "sigma"
    with pytest.raises(
        SweepError,
        match=r"sigma.* must be the standard deviation of each real .* may be relative, convert",
    ):
        imported(table | {name: FREQUENCY}, unit="pu" if unit == "dB" else None)


def test_percent_of_one_per_unit_is_a_unit_where_the_matrix_has_it_too():
    table = columns(" [%]", " [%]", (100 / BASE_S,) * 2) | {"sigma [%]": FREQUENCY}
    sigma = imported(table).answered().points[0].sigma
    assert sigma is not None
    np.testing.assert_allclose(sigma[:, 0, 0], 0.01 * FREQUENCY, rtol=1e-12)


@pytest.mark.parametrize("name", ["sigma", "amplitude"])
def test_a_deviation_and_an_amplitude_are_not_negative(name: str):
    with pytest.raises(SweepError, match=f"{name} must not be negative; found -"):
        imported(columns(" [mS]", " [mS]") | {name: -FREQUENCY})


@pytest.mark.slow
def test_a_row_of_units_in_a_workbook_counts_for_each_part(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    book, table = openpyxl.Workbook(), columns("", "", (1e3, 1.0))
    for row in (
        list(table),
        ["Hz", *["mS", "S"] * 4],
        *(list(map(float, row)) for row in zip(*table.values(), strict=True)),
    ):
        book.worksheets[0].append(row)
    book.save(tmp_path / "scan.xlsx")
    found = (
        import_tables(read_tables(tmp_path / "scan.xlsx"), **SAID).answered().points[0].admittance
        * BASE_S
    )
    np.testing.assert_allclose(found, ADMITTANCE, rtol=1e-12)


@pytest.mark.slow
def test_units_among_the_attributes_of_hdf5_arrays_count_for_each_part(tmp_path: Path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        for name, values in columns("", "", (1e3, 1.0)).items():
            file[name] = values
            file[name].attrs["units"] = (
                "Hz" if name == "f" else "mS" if name.endswith("re") else "S"
            )
    found = (
        import_tables(read_tables(tmp_path / "scan.h5"), **SAID).answered().points[0].admittance
        * BASE_S
    )
    np.testing.assert_allclose(found, ADMITTANCE, rtol=1e-12)
