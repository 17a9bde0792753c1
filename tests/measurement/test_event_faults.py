"""What recorders get wrong, each as CSV, COMTRADE and workbook: recognised, and said in one
sentence by `ibrid inspect`.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ibrid.cli import main
from ibrid.measurement.formats.event_csv import COLUMNS

F0, BEGIN, END = 60.0, 0.1, 0.2
V_BASE, S_BASE = 400.0, 10e3
PEAK_V, PEAK_I = V_BASE * np.sqrt(2 / 3), S_BASE / V_BASE * np.sqrt(2 / 3)
TIME = np.arange(0, 0.3, 2e-4)
Recorded = tuple[np.ndarray, np.ndarray, np.ndarray]


def phases(value: np.ndarray | complex, frequency: float = F0) -> np.ndarray:
    vector = value * np.exp(2j * np.pi * frequency * TIME + 0.3j)
    return np.stack([(vector * np.exp(-2j * np.pi * k / 3)).real for k in range(3)])


AWAY = (TIME > BEGIN) & (TIME < END)
V, I = np.where(AWAY, 0.5, 1.0), np.where(AWAY, 1.3, 0.8 - 0.1j)


def recorded(frequency: float = F0) -> Recorded:
    return TIME, PEAK_V * phases(V, frequency), PEAK_I * phases(I, frequency)


def cut(rows: np.ndarray) -> Recorded:
    time, v, i = recorded()
    return time[rows], v[:, rows], i[:, rows]


def changed(v: Callable = lambda v: v, i: Callable = lambda i: i) -> Recorded:
    time, voltage, current = recorded()
    return time, v(voltage), i(current)


FAULTS = {
    "nothing": (recorded(), ""),
    "no rest": (cut(TIME > 0.09), "where its operating point is read"),
    "another frequency": (recorded(50.0), "must turn at about f0_hz = 60; found 50.00 Hz"),
    "phases swapped": (
        changed(lambda v: v[[0, 2, 1]], lambda i: i[[0, 2, 1]]),
        "the phases turn the wrong way",
    ),
    "a voltage reversed": (
        changed(v=lambda v: v * [[1], [-1], [1]]),
        "a voltage of the phases is reversed or missing",
    ),
    "a voltage missing": (
        changed(v=lambda v: v * [[1], [0], [1]]),
        "the voltage of phase b is missing",
    ),
    "phases of the current swapped": (
        changed(i=lambda i: i[[0, 2, 1]]),
        "a channel of the currents is swapped",
    ),
    "a current missing": (
        changed(i=lambda i: i * [[1], [1], [0]]),
        "a channel of the currents is swapped, reversed or missing",
    ),
    "currents of the next phase": (
        changed(i=lambda i: i[[1, 2, 0]]),
        "not in the order of those of the voltage",
    ),
    "clipped": (changed(i=lambda i: np.clip(i, -1.1 * PEAK_I, 1.1 * PEAK_I)), "clipped"),
    "a gap": (cut((TIME < 0.185) | (TIME > 0.215)), "gap"),
    "between phases": (changed(v=lambda v: np.sqrt(3) * v), "nearly 1.732: between two phases"),
    "kV": (changed(v=lambda v: v / 1e3), "kV in place of V?"),
    "kA": (changed(i=lambda i: i / 1e3), "kA in place of A"),
    "A": (changed(i=lambda i: 1e3 * i), "A in place of kA"),
    "current in": (changed(i=lambda i: -i), "import it with --current in"),
}


def as_csv(folder: Path, time: np.ndarray, v: np.ndarray, i: np.ndarray) -> Path:
    rows = [",".join(["dip", *map(repr, row)]) for row in np.column_stack([time, *v, *i]).tolist()]
    keys = [f"# f0_hz: {F0}", "# unit: si", f"# s_base_va: {S_BASE}", f"# v_base_v: {V_BASE}"]
    (folder / "dip.csv").write_text(
        "\n".join([*keys, ",".join(["record", "t", *COLUMNS["abc"]]), *rows]) + "\n"
    )
    return folder / "dip.csv"


def as_comtrade(folder: Path, time: np.ndarray, v: np.ndarray, i: np.ndarray) -> Path:
    values = np.concatenate([v, i])
    steps = np.abs(values).max(axis=1) / 30000 + 1e-9
    names = [
        ("VA", "A", "V"),
        ("VB", "B", "V"),
        ("VC", "C", "V"),
        ("IA", "A", "A"),
        ("IB", "B", "A"),
        ("IC", "C", "A"),
    ]
    head = ["station,1,1999", "6,6A,0D"]
    head += [
        f"{k + 1},{n},{p},,{u},{a!r},0,0,-32767,32767,1,1,P"
        for k, ((n, p, u), a) in enumerate(zip(names, steps.tolist(), strict=True))
    ]
    stamps = ["01/01/2020,00:00:00.000000"] * 2
    (folder / "dip.cfg").write_text(
        "\n".join([*head, f"{F0:g}", "1", f"5000,{len(time)}", *stamps, "ASCII", "1", ""])
    )
    table = np.column_stack(
        [
            np.arange(len(time)) + 1,
            np.round(1e6 * (time - time[0])),
            *np.round(values / steps[:, None]),
        ]
    )
    np.savetxt(folder / "dip.dat", table, "%d", delimiter=",")
    return folder / "dip.cfg"


def as_workbook(folder: Path, time: np.ndarray, v: np.ndarray, i: np.ndarray) -> Path:
    openpyxl = pytest.importorskip(
        "openpyxl", reason="workbooks are written by openpyxl (pip install openpyxl)"
    )
    book = openpyxl.Workbook()
    book.active.append(["t", *COLUMNS["abc"]])
    for row in np.column_stack([time, *v, *i]).tolist():
        book.active.append(row)
    book.save(folder / "dip.xlsx")
    return folder / "dip.xlsx"


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(one, marks=() if one == "a voltage missing" else pytest.mark.nightly)
        for one in FAULTS
    ],
)
def test_a_fault_of_a_recorder_is_said_in_every_format(
    fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    seen, sentence = FAULTS[fault]
    for write, options in (
        (as_csv, []),
        (as_comtrade, ["--base", "10kVA,400V"]),
        (as_workbook, ["--base", "10kVA,400V"]),
    ):
        status = main(["inspect", str(write(tmp_path, *seen)), *options])
        printed, refused = capsys.readouterr()
        assert status == (2 if refused else 0)
        assert len(refused.strip().splitlines()) == (1 if refused else 0)
        told = " ".join((refused + printed.partition("mind:")[2]).split())
        assert (sentence in told) if sentence else not told, (write.__name__, told)


@pytest.mark.slow
def test_what_was_remarked_on_reading_is_said_once_and_again_of_the_file_that_import_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip(
        "comtrade", reason="COMTRADE files are read by comtrade (pip install 'ibrid[comtrade]')"
    )
    seen, out = as_comtrade(tmp_path, *FAULTS["clipped"][0]), tmp_path / "out.csv"
    assert main(["import", str(seen), "--base", "10kVA,400V", "--out", str(out)]) == 0
    said = capsys.readouterr().err.splitlines()
    clipped = [line for line in said if "clipped" in line]
    assert len(clipped) == len({line.rstrip(".") for line in said if "clipped" in line}) > 0
    for file, where in (
        (out, tmp_path / "again.csv"),
        (tmp_path / "again.csv", tmp_path / "third.csv"),
    ):
        assert main(["import", str(file), "--out", str(where)]) == 0
        assert [
            line for line in capsys.readouterr().err.splitlines() if "clipped" in line
        ] == clipped
    assert main(["inspect", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.partition("mind:")[2].split())
    assert all(line.partition("mind: ")[2] in printed for line in clipped)
