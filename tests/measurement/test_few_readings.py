"""f0 is read at as many operating points as decide about it, and a table whose rows have names is
looked at for names of signals once; plain cells are read together.
"""

from pathlib import Path

import numpy as np
import pytest
from constant_current import constant_current_sweep

from ibrid.measurement.conventions import frequency_base
from ibrid.measurement.conventions.contradictions import check_conventions
from ibrid.measurement.conventions.frequency_base import (
    contradicting_readings,
    frequency_readings,
    other_frequency,
)
from ibrid.measurement.importing.cell_number import number
from ibrid.measurement.importing.foreign_table import _column, _numbers_in
from ibrid.measurement.importing.numbers.number_format import UNSAID
from ibrid.measurement.read_events import is_events_file


@pytest.mark.parametrize(("declared", "read"), [(50.0, 1), (60.0, 2)])
def test_an_f0_that_is_right_is_read_at_one_operating_point(monkeypatch, declared, read):
    """One reading of the declared f0 leaves no contradiction; one needs all operating points."""
    sweep = constant_current_sweep(50.0, declared)
    whole = other_frequency(frequency_readings(sweep), declared)
    assert other_frequency(contradicting_readings(sweep), declared) == whole
    places = []

    def counted(point, noise, read=frequency_base.frequency_reading):
        places.append(point.op.name)
        return read(point, noise)

    monkeypatch.setattr(frequency_base, "frequency_reading", counted)
    assert (check_conventions(sweep).status == "doubt") == (declared != 50.0)
    assert len(places) == read


def test_rows_of_a_table_that_names_its_points_are_no_names_of_signals(tmp_path: Path, monkeypatch):
    from ibrid.measurement import read_events

    looked = []
    monkeypatch.setattr(read_events, "_has_channels", lambda cells, **_: looked.append(cells))
    names = ["case", "f", *(f"Y{e}_{c}" for e in ("dd", "dq", "qd", "qq") for c in ("re", "im"))]
    rows = [
        f"op{k},{f:g}," + ",".join("-0.25" for _ in range(8))
        for k in range(20)
        for f in np.geomspace(1, 1000, 10)
    ]
    (tmp_path / "a.csv").write_text("\n".join([",".join(names), *rows]))
    assert not is_events_file(tmp_path / "a.csv")
    assert looked == [names]


@pytest.mark.parametrize(
    "cells",
    [
        ["1", " -2.5e3", "nan", "inf"],
        ["1_000", "2"],
        ["", "3"],
        ["1+2j", "4"],
        ["1,255.9", "2"],
        ["five", "6"],
    ],
)
def test_cells_that_are_read_at_once_are_what_they_are_one_by_one(cells):
    """The plain numbers of a row or a column are converted together."""
    singly = [number(cell, False) for cell in cells]
    assert _numbers_in(cells, False) == sum(one is not None for one in singly)
    if all(one is not None for one in singly):
        np.testing.assert_array_equal(_column(cells, False, UNSAID), np.array(singly, complex))
    else:
        assert _column(cells, False, UNSAID).tolist() == cells
