"""A CSV is read in blocks of rows; what is refused, and with which words, is as if each row had
been read alone.
"""

import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.formats import csv_table
from ibrid.measurement.read import read_sweep

HEAD = "op,p,q,v,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im,sigma,repeat\n"
NUMBERS = "2,3,4,5e-3,6,7,-8,0.01"
ROWS = [
    f'"p=1,q={q}",1,{q},,{hz},{hz}.5,{NUMBERS},{run}'
    for q in (0.3, 0)
    for run in (1, 2)
    for hz in range(1, 40)
]
#: What may stand in a cell: as it was, or spoiled.
SPOILED = (
    "",
    " ",
    "nan",
    "inf",
    "1_0",
    "x",
    "-1",
    "0",
    "1e400",
    '"1"',
    ' "1"',
    '"1"2',
    '"',
    "1.5",
    "\u0661",
    "0x10",
    "1,2",
    "'",
    "#",
    "1 2",
    "  3  ",
    "\u00a04",
    "-0",
    "+.5e1",
    "2.",
    "1e-400",
    "1d5",
    "\u202e",
    "n" * 300,
)


def answer(path, text: str) -> object:
    """The arrays of a file, or the words with which it is refused."""
    path.write_text(text, encoding="utf-8")
    try:
        points = read_sweep(path).points
    except SweepError as reason:
        return str(reason)
    return [
        (one.op, one.frequency.tolist(), one.repeats.tolist(), one.sigma.tolist()) for one in points
    ]


@pytest.mark.nightly
def test_blocks_and_single_rows_say_the_same(tmp_path, monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(1)
    path = tmp_path / "sweep.csv"
    texts = [HEAD + "\n".join(ROWS)]
    for spoiled in SPOILED:
        for column in range(15):
            row = int(rng.integers(len(ROWS)))
            cells = [*ROWS[row].rpartition('",')[:1], *ROWS[row].rpartition('",')[2].split(",")]
            cells = [f'{cells[0]}"', *cells[1:]]
            cells[column] = spoiled
            texts.append(HEAD + "\n".join([*ROWS[:row], ",".join(cells), *ROWS[row + 1 :]]))
    monkeypatch.setattr(csv_table, "_BLOCK", 7)
    fast = [answer(path, text) for text in texts]
    monkeypatch.setattr(csv_table, "_rows", lambda lines, columns: None)
    alone = [answer(path, text) for text in texts]
    assert [text for text, one, other in zip(texts, fast, alone, strict=True) if one != other] == []
    assert sum(isinstance(one, str) for one in alone) > 200


def test_rows_are_not_read_one_by_one(tmp_path, monkeypatch: pytest.MonkeyPatch):
    def read_alone(*_: object) -> None:
        raise AssertionError("a row was read alone")

    monkeypatch.setattr(csv_table, "_row", read_alone)
    assert isinstance(answer(tmp_path / "sweep.csv", HEAD + "\n".join(ROWS)), list)


def test_many_operating_points_are_told_apart_in_one_pass(
    tmp_path, monkeypatch: pytest.MonkeyPatch
):
    passes = []
    monkeypatch.setattr(
        csv_table.Table,
        "at",
        lambda self, rows, at=csv_table.Table.at: (passes.append(len(rows)), at(self, rows))[1],
    )
    rows = [
        row.replace("q=0.3", f"n{k}").replace("q=0", f"m{k}") for k in range(30) for row in ROWS
    ]
    assert len(answer(tmp_path / "sweep.csv", HEAD + "\n".join(rows))) == 60
    assert sum(passes) <= 4 * len(rows)


def test_an_endless_line_is_refused_before_it_is_taken_apart(tmp_path):
    (tmp_path / "sweep.csv").write_text(HEAD + "1," * 2_000_000)
    with pytest.raises(
        SweepError, match="must have lines of at most 20000 characters; line 2 has 4000000"
    ):
        read_sweep(tmp_path / "sweep.csv")


def test_an_endless_gap_in_a_comment_is_read_in_one_pass(tmp_path):
    text = f"# unit:{' ' * 19_000}pu{' ' * 900}\n# note:{' ' * 19_000}x\n"
    (tmp_path / "sweep.csv").write_text(text * 100 + HEAD + "\n".join(ROWS))
    assert len(read_sweep(tmp_path / "sweep.csv").points) == 2
