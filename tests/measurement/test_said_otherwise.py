"""What the user says of a table wins over what stands in it, and a remark says what stood there."""

from pathlib import Path

import numpy as np
import pytest

from ibrid.measurement.importing.foreign_table import array_table
from ibrid.measurement.importing.importing import import_files, import_tables

ENTRIES = ",".join(
    f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im")
)
NUMBERS = "-1,0.1,0.3,0.2,0.3,0.1,1,0.1"
SAID = {
    "unit": "pu",
    "f0_hz": 50.0,
    "current": "out",
    "q_axis": "leads",
    "voltage_axis": "d",
    "p": 0.5,
    "q": 0.1,
}


def remarks(
    folder: Path,
    *,
    names: str = "",
    values: str = "",
    above: str = "",
    head: str = ENTRIES,
    **said: object,
):
    """What is remarked on a table with columns of their own before the matrix, and the p, q, v that
    were taken.
    """
    rows = "\n".join(f"{f},{values}{NUMBERS}" for f in (1, 2, 4))
    (folder / "scan.csv").write_text(f"{above}f,{names}{head}\n{rows}\n")
    read = import_files([folder / "scan.csv"], **{**SAID, **said})
    point = read.answered().points[0].op
    return [one for one in read.remarks if " as " in one and "scan.csv" in one], (
        point.p,
        point.q,
        point.v,
    )


@pytest.mark.parametrize(
    ("table", "found"),
    [
        ({"above": "# p: 0.8\n"}, "p: 0.5 as said, while {} says 0.8 in p"),
        (
            {"above": "# Q: -20 kvar\n", "base": "10kVA,400V"},
            "q: 0.1 as said, while {} says -20 kvar in Q",
        ),
        ({"names": "p,", "values": "0.8,"}, "p: 0.5 as said, while {} says 0.8 in p"),
        (
            {"names": "P [kW],", "values": "8,", "base": "10kVA,400V"},
            "p: 0.5 as said, while {} says 8 in P [kW]",
        ),
        ({"names": "P [kW],", "values": "5,"}, "p: 0.5 as said, while {} says 5 in P [kW]"),
        ({"names": "v,", "values": "1.05,", "v": 1.0}, "v: 1 as said, while {} says 1.05 in v"),
    ],
)
def test_a_power_or_voltage_that_the_table_says_otherwise_is_remarked(
    tmp_path: Path, table: dict, found: str
):
    said, taken = remarks(tmp_path, **table)
    assert said == [found.format(tmp_path / "scan.csv")]
    assert taken == pytest.approx((0.5, 0.1, 1.0))  # means over rows


def test_a_table_that_says_the_same_in_another_unit_is_not_remarked(tmp_path: Path):
    table = {"names": "P [kW],q,v,", "values": "5,0.1,1.05,", "base": "10kVA,400V", "v": 1.05}
    assert remarks(tmp_path, above="# f0: 50 Hz\n# current: out\n", **table)[0] == []


def test_single_variables_of_a_file_are_remarked():
    arrays = {
        "f": np.array([1.0, 2.0, 5.0]),
        "Y": np.arange(1, 13).reshape(3, 2, 2) * 1j,
        "p": np.array(0.8),
    }
    read = import_tables([array_table(arrays, "scan.mat", "scan")], **SAID)
    assert "p: 0.5 as said, while scan.mat says 0.8 in p" in read.remarks


def test_the_power_of_a_point_that_is_named_is_remarked(tmp_path: Path):
    said, taken = remarks(
        tmp_path, above="# p: 0.8\n# q: 0.1\n", p=None, q=None, op="full:p=0.5,q=0.1"
    )
    assert said == [f"p: 0.5 as said, while {tmp_path / 'scan.csv'} says 0.8 in p"]
    assert taken[0] == 0.5


@pytest.mark.parametrize("name", ["V [V]", "v [kV]", "V"])
def test_a_voltage_of_a_named_point_may_stand_beside_volts(tmp_path: Path, name: str):
    values = "0.408," if "k" in name else "408,"
    table = {"names": f"{name},", "values": values, "base": "10kVA,400V", "p": None, "q": None}
    assert remarks(tmp_path, op="full:p=0.5,q=0.1,v=1.02", **table) == (
        [],
        pytest.approx((0.5, 0.1, 1.02)),
    )
    said, taken = remarks(tmp_path, op="full:p=0.5,q=0.1,v=1.05", **table)
    assert said == [
        f"v: 420 as said, while {tmp_path / 'scan.csv'} says 408{' V' * (name != 'V')} in v"
    ]
    assert taken[2] == pytest.approx(1.05)


def test_a_frequency_and_a_direction_that_a_comment_says_otherwise_are_remarked(tmp_path: Path):
    said, _ = remarks(tmp_path, above="# f0: 60 Hz\n# current: in\n")
    place = tmp_path / "scan.csv"
    assert said == [
        f"current: out as said, while {place} says in",
        f"f0_hz: 50 as said, while {place} says 60",
    ]


def test_the_unit_that_wins_over_another_is_said(tmp_path: Path):
    """That of the columns where it differs by a prefix, that of the user where it measures
    something else.
    """
    head = ",".join(f"{name} [mS]" for name in ENTRIES.split(","))
    place, base = tmp_path / "scan.csv", "10kVA,3kV"
    expected = {
        "S": f"unit: mS as the columns of {place} say, which are nearer to the numbers than S",
        "pu": f"unit: pu as said, while the columns of {place} say mS",
        "pu:20kVA,3kV": f"unit: pu:20kVA,3kV as said, while the columns of {place} say mS",
    }
    for unit, words in expected.items():
        assert remarks(tmp_path, head=head, unit=unit, base=base)[0] == [words]
    assert remarks(tmp_path, head=head, unit="mS", base=base)[0] == []
    assert remarks(tmp_path, above="# unit: mS\n", unit="S", base="10kVA,400V")[0] == [
        f"unit: S as said, while {place} says mS"
    ]
