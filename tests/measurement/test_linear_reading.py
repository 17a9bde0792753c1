"""Reading twice as much takes twice the work, and what is too much is refused in a sentence: work
is counted, not timed.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from counting import lines_run

from ibrid.errors import SweepError
from ibrid.measurement.formats.files import LONGEST_LINE
from ibrid.measurement.formats.grouping import first_near, rows_of_each
from ibrid.measurement.importing import foreign_table, point_rows, table_files
from ibrid.measurement.importing.cell_number import number
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.table_files import read_tables

SAID = {"unit": "pu", "f0_hz": 50, "current": "out", "q_axis": "leads", "frame_deg": 0}
HEAD = "freq_hz,p,q,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im"


def doubles(work: Callable[[int], object], size: int) -> bool:
    """Whether twice the size takes at most a tenth more than twice the lines."""
    first, second = (lines_run(lambda size=size: work(size)) for size in (size, 2 * size))
    return second < 2.2 * first


def table(path: Path, rows: int, power: Callable[[int], float]) -> Path:
    frequency = np.geomspace(1, 1000, rows)
    response = -5 / (1 + 1j * frequency / 100)
    lines = [
        f"{f!r},{power(k)!r},0.3,{y.real!r},{y.imag!r},0.1,0,0.1,0,{y.real!r},{y.imag!r}"
        for k, (f, y) in enumerate(zip(frequency.tolist(), response.tolist(), strict=True))
    ]
    path.write_text("\n".join([HEAD, *lines]))
    return path


def test_points_of_a_p_each_are_grouped_in_linear_work():
    assert doubles(lambda n: first_near(np.arange(3.0 * n).reshape(n, 3), 0.02), 400)
    assert doubles(lambda n: rows_of_each(list(range(n))), 400)


def test_near_points_belong_to_the_first_of_them():
    points = np.array(
        [[0.0, 0.0], [0.015, 0.0], [0.03, 0.0], [0.021, 0.0], [np.nan, 0.0], [np.nan, 0.0]]
    )
    assert first_near(points, 0.02).tolist() == [0, 0, 2, 2, 4, 5]


def test_near_points_are_those_that_all_pairs_would_find():
    points = np.random.default_rng(0).uniform(0, 0.2, (300, 3))
    first: list[int] = []
    for k, point in enumerate(points):
        before = [
            one
            for one in range(k)
            if first[one] == one and np.abs(points[one] - point).max() <= 0.02
        ]
        first.append(before[0] if before else k)
    assert first_near(points, 0.02).tolist() == first


def test_a_table_of_many_operating_points_is_imported_in_linear_work(tmp_path: Path):
    files = {rows: table(tmp_path / f"{rows}.csv", rows, lambda k: 0.05 * k) for rows in (100, 200)}
    work = {
        rows: lines_run(lambda file=file: import_files([file], **SAID))
        for rows, file in files.items()
    }
    assert work[200] < 2.2 * work[100]


@each_of("times", [1, 2])
def test_frequencies_that_come_again_in_every_row_are_asked_about_in_linear_work(
    tmp_path: Path, times: int
):
    def again(rows: int) -> int:
        file = tmp_path / f"{rows}.csv"
        lines = [f"{1 + k % times},0.{k:04},0.5,0,0.1,0,0.1,0,0.5,0" for k in range(rows)]
        file.write_text("\n".join([HEAD.replace(",p,q,", ",note,"), *lines]))
        with pytest.raises(
            SweepError, match="runs over the frequencies are operating points or repeats"
        ):
            import_files([file], **SAID).answered()
        return rows

    assert doubles(again, 150)


def test_more_runs_than_a_sweep_has_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(point_rows, "MOST_RUNS", 20)
    file = tmp_path / "trace.csv"
    file.write_text("\n".join([HEAD.replace(",p,q,", ","), *["50,0.5,0,0.1,0,0.1,0,0.5,0"] * 30]))
    with pytest.raises(
        SweepError,
        match=r"at most 20 runs .*; found 29, is the column of frequencies the right one",
    ):
        import_files([file], **SAID)


def test_one_frequency_a_point_is_remarked_on(tmp_path: Path):
    imported = import_files([table(tmp_path / "many.csv", 12, lambda k: 0.05 * k)], **SAID)
    assert any(
        "each of 12 operating points has one frequency" in remark for remark in imported.remarks
    )


def test_a_line_with_quotes_is_taken_apart_in_linear_work():
    assert doubles(lambda n: foreign_table._cells('1,"a,b",' * n, ","), 500)
    assert foreign_table._cells('1,"a,b",2,"c"', ",") == ["1", "a,b", "2", "c"]
    assert foreign_table._cells('a,5",b', ",") == ["a,5", "b"]


def test_a_line_that_is_too_long_and_too_many_lines_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    file = tmp_path / "long.csv"
    file.write_text("f,p\n" + "1," * LONGEST_LINE + "2\n")
    with pytest.raises(SweepError, match=f"lines of at most {LONGEST_LINE} characters; line 2 has"):
        read_tables(file)
    monkeypatch.setattr(table_files, "MOST_LINES", 20)
    with pytest.raises(SweepError, match="must have at most 20 lines; found 31"):
        read_tables(table(tmp_path / "many.csv", 30, lambda _: 1.0))


def test_a_long_table_has_its_separator_chosen_by_some_of_its_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(foreign_table, "CHOOSING", 10)
    (read,) = read_tables(table(tmp_path / "many.csv", 60, lambda _: 1.0))
    assert (list(read.columns), len(read.line)) == (HEAD.split(","), 60)


@each_of("text", ["1" * 400, "1." + "0" * 200 + "x", "1_000"])
def test_a_cell_is_a_number_or_text_whatever_its_length(text: str):
    found = number(text, False)
    assert (found is None) == (text[-1] == "x" or "_" in text) or not np.isfinite(found)


def test_a_map_of_endless_parts_is_refused_by_its_length(tmp_path):
    (tmp_path / "a.csv").write_text("f,a,b\n1,2,3\n2,3,4\n3,4,5\n")
    with pytest.raises(SweepError, match="at most 4,000 characters"):
        import_files([tmp_path / "a.csv"], ["Ydd=" + "+j".join(["a"] * 30_000)])
