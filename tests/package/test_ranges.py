"""No number of any file or option ends in a traceback: it is taken, or its key and range are named,
with exit status 2.
"""

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from fitted import evaluated

import ibrid
from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.foreign_data import json_in, toml_in
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import program_text

VALUES = ("0", "-1", "1e308", "1e-308", "-1e308", "nan", "inf", "-inf", "9" * 400, "", "text")
SWEEP_KEYS = ("f0_hz", "s_base_va", "v_base_v", "sampling_hz", "frame_deg")
ENTRIES = ("Ydd_re", "Ydd_im", "Ydq_re", "Ydq_im", "Yqd_re", "Yqd_im", "Yqq_re", "Yqq_im")
COLUMNS = ("p", "q", "v", "freq_hz", *ENTRIES, "sigma", "repeat", "amplitude")
FREQUENCY = (1.0, 5.0, 20.0, 80.0, 300.0, 1200.0)
CFG = """st,dev,1999
6,6A,0D
{channels}
{lf}
{nrates}
{rate},{last}
01/01/2020,00:00:00.000000
01/01/2020,00:00:00.100000
ASCII
{timemult}
"""
CHANNEL = {
    "a": "0.01",
    "b": "0",
    "skew": "0",
    "min": "-32767",
    "max": "32767",
    "primary": "1",
    "secondary": "1",
}
PORT = {
    "series": {"R": "0.01", "L": "0.1"},
    "shunt": {"R": "0.01", "C": "0.01"},
    "transformer": {"R": "0.01", "L": "0.1", "ratio": "1.0", "shift_deg": "30.0"},
}


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def sweep(keys: dict[str, str] | None = None, cells: dict[str, str] | None = None) -> str:
    """The text of a sweep file with some header keys, and other cells in its third row."""
    rows = []
    for k, frequency in enumerate(FREQUENCY):
        y = -1 / (0.02 + 0.1j * frequency / 50)
        numbers = dict(
            zip(ENTRIES, (y.real, y.imag, 0.1, 0.01, 0.1, 0.01, y.real, y.imag), strict=True)
        )
        row = {
            "p": 0.5,
            "q": 0.1,
            "v": 1.0,
            "freq_hz": frequency,
            **numbers,
            "sigma": 0.01,
            "repeat": 0,
            "amplitude": 0.01,
        }
        rows.append(
            {name: repr(value) for name, value in row.items()} | (cells or {} if k == 2 else {})
        )
    lines = [f"# {key}: {value}" for key, value in (keys or {}).items()]
    lines += [
        ",".join(("op", *COLUMNS)),
        *(",".join(("a", *(row[name] for name in COLUMNS))) for row in rows),
    ]
    return "\n".join(lines) + "\n"


def events(keys: dict[str, str], cells: dict[str, str]) -> str:
    """The text of an events file: a dip in dq."""
    names = ("t", "v_d", "v_q", "i_d", "i_q", "sigma")
    lines = [f"# {key}: {value}" for key, value in keys.items()] + [",".join(("record", *names))]
    for k, t in enumerate(np.arange(0, 0.16, 1e-3).tolist()):
        v = 1.0 if k < 100 else 0.7
        row = dict(zip(names, map(repr, (t, v, 0.0, 0.5, -0.1, 0.01)), strict=True)) | (
            cells if k == 20 else {}
        )
        lines.append(",".join(("dip", *(row[name] for name in names))))
    return "\n".join(lines) + "\n"


def comtrade(**other: str) -> list[str]:
    """Files of a record of six channels; the first of them, or a line of the configuration, as
    said.
    """
    told = {"lf": "50", "nrates": "1", "rate": "1000", "last": "200", "timemult": "1"} | other
    first = CHANNEL | other
    names = ("va", "vb", "vc", "ia", "ib", "ic")
    lines = []
    for number, name in enumerate(names, 1):
        one = first if number == 1 else CHANNEL
        unit = "VA"[name[0] == "i"]
        lines.append(f"{number},{name},,,{unit},{','.join(one[key] for key in CHANNEL)},P")
    time = np.arange(200) / 1000
    waves = [
        size * np.cos(2 * np.pi * (50 * time - k / 3)) for size in (32600, 1000) for k in range(3)
    ]
    rows = [
        f"{k + 1},{1000 * k},{','.join(f'{wave[k]:.0f}' for wave in waves)}" for k in range(200)
    ]
    Path("record.cfg").write_text(
        CFG.format(channels="\n".join(lines), **{k: v for k, v in told.items() if k not in CHANNEL})
    )
    Path("record.dat").write_text("\n".join(rows) + "\n")
    return ["inspect", "record.cfg", "--base", "10kVA,400V"]


def written(name: str, text: str) -> str:
    Path(name).write_text(text)
    return name


def failures(cases: Iterator[tuple[str, list[str]]], capsys: pytest.CaptureFixture) -> list[str]:
    """What commands do that end neither with an answer nor with a sentence."""
    found = []
    for what, command in cases:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            status = main(command)
        said = capsys.readouterr().err
        if status not in (0, 2) or "Warning" in said:
            found.append(f"{what[:80]}: {status}, {said.strip()[-200:]}")
    return found


def of_sweeps() -> Iterator[tuple[str, list[str]]]:
    si = {"unit": "S", "s_base_va": "10e3", "v_base_v": "400"}
    for value in VALUES:
        for key in SWEEP_KEYS:
            file = written("sweep.csv", sweep({**(si if "base" in key else {}), key: value}))
            yield f"sweep {key} {value}", ["inspect", file]
        for key in COLUMNS:
            yield (
                f"sweep column {key} {value}",
                ["inspect", written("sweep.csv", sweep(cells={key: value}))],
            )


def of_meta() -> Iterator[tuple[str, list[str]]]:
    rows = [f"{f} -1 0.1 0.1 0 0.1 0 -1 0.1" for f in FREQUENCY]
    written("scan.y2p", "\n".join(["# Hz Y RI R 1", *rows]) + "\n")
    for value in VALUES:
        for key in (*SWEEP_KEYS, "p", "q", "v"):
            keys = {"p": "0.5", "q": "0.1"} | {key: value}
            written("scan.y2p.meta", "".join(f"{name}: {text}\n" for name, text in keys.items()))
            yield f"meta {key} {value}", ["inspect", "scan.y2p"]


def of_ports() -> Iterator[tuple[str, list[str]]]:
    written("sweep.csv", sweep())
    for value in VALUES:
        for kind, usual in PORT.items():
            for key in (*usual, "tolerance", "v_base_v"):
                lines = {**usual, key: value}
                text = "\n".join(f"{name} = {number}" for name, number in lines.items())
                file = written("port.toml", f'[[element]]\nkind = "{kind}"\nunit = "pu"\n{text}\n')
                yield (
                    f"port {kind} {key} {value}",
                    ["gap", "none.py", "sweep.csv", "--port", file, "--out", "gap"],
                )


def of_events() -> Iterator[tuple[str, list[str]]]:
    si = {"unit": "si", "s_base_va": "10e3", "v_base_v": "400"}
    for value in VALUES:
        for key in ("f0_hz", "s_base_va", "v_base_v"):
            yield (
                f"events {key} {value}",
                ["inspect", written("dip.csv", events({**si, key: value}, {}))],
            )
        for key in ("t", "v_d", "i_q", "sigma"):
            yield (
                f"events column {key} {value}",
                ["inspect", written("dip.csv", events({}, {key: value}))],
            )


def of_options() -> Iterator[tuple[str, list[str]]]:
    written("sweep.csv", sweep())
    written("table.csv", "\n".join(line.partition(",")[2] for line in sweep().splitlines()))
    comtrade()
    table = [
        "import",
        "table.csv",
        "--out",
        "out.csv",
        "--unit",
        "S",
        "--current",
        "out",
        "--q-axis",
        "leads",
        "--f0-hz",
        "50",
    ]
    for value in VALUES:
        yield f"--base {value}", ["inspect", "record.cfg", "--base", f"{value},400V"]
        yield f"--base {value}", ["inspect", "record.cfg", "--base", f"10kVA,{value}"]
        yield f"--sampling-hz {value}", ["inspect", "sweep.csv", "--sampling-hz", value]
        yield f"import --base {value}", [*table, "--base", f"{value},400"]
        yield f"import --base ,{value}", [*table, "--base", f"10e3,{value}"]
        for option in ("--f0-hz", "--sampling-hz", "--frame-deg", "--p", "--q", "--v"):
            yield f"import {option} {value}", [*table, "--base", "10kVA,400V", f"{option}={value}"]
        for option in ("--noise-db", "--repeats", "--seed"):
            yield (
                f"sweep {option} {value}",
                [
                    "sweep",
                    "paper_like",
                    f"{option}={value}",
                    "--freq",
                    "5:50:3",
                    "--out",
                    "made.csv",
                ],
            )
        for text in (f"{value}:50:3", f"5:{value}:3"):
            yield (
                f"sweep --freq {text}",
                ["sweep", "paper_like", f"--freq={text}", "--out", "made.csv"],
            )
        for text in (f"p={value},q=0", f"p=1,q={value}", f"p=1,q=0,v={value}"):
            yield (
                f"sweep --op {text}",
                ["sweep", "paper_like", f"--op={text}", "--freq", "5:50:3", "--out", "made.csv"],
            )
        yield (
            f"--set {value}",
            [
                "sweep",
                "paper_like",
                "--set",
                f"plant.L_F={value}",
                "--freq",
                "5:50:3",
                "--out",
                "made.csv",
            ],
        )


def of_programs() -> Iterator[tuple[str, list[str]]]:
    text = program_text(textbook("gfl"))
    assert 'g.add("LCL", "plant")' in text
    for value in VALUES:
        changed = text.replace('"plant")', f'"plant", L_F={value})')
        yield f"program {value}", ["check", written("program.py", changed)]


@pytest.mark.nightly
@pytest.mark.parametrize(
    "cases",
    [of_sweeps, of_meta, of_ports, of_events, of_options, of_programs],
    ids=lambda one: one.__name__,
)
def test_hostile_numbers_are_taken_or_named(cases, capsys: pytest.CaptureFixture):
    assert failures(cases(), capsys) == []


@pytest.mark.nightly
def test_hostile_numbers_of_comtrade_are_taken_or_named(capsys: pytest.CaptureFixture):
    # each is read in a process of its own, so a few of the values
    keys = ("rate", "lf", "a", "skew", "primary", "last", "timemult", "nrates")
    cases = (
        (f"cfg {key} {value}", comtrade(**{key: value}))
        for key in keys
        for value in ("0", "-1", "1e300", "nan")
    )
    assert failures(cases, capsys) == []


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 40_000) + " = 1",
        "[" + ".".join(["a"] * 40_000) + "]",
        "x = {" + "a." * 9_000 + "a = 1}",
    ],
)
def test_a_name_of_thousands_of_parts_takes_no_memory(text: str):
    with pytest.raises(ValueError, match="more than forty parts"):
        toml_in(text)


def test_a_name_that_stands_twice_in_json_is_refused():
    assert json_in('[{"p": 1}, {"p": -1}]') == [{"p": 1}, {"p": -1}]
    with pytest.raises(
        ValueError, match="the name 'p' stands twice in one object, keep one of them"
    ):
        json_in('{"q": 0, "op": {"p": 1, "v": 1, "p": -1}}')


def test_numbers_and_names_with_points_are_no_deep_names():
    text = "x = [" + ", ".join(["0.5"] * 1000) + "]\na.b.c = 1\n'p.q' = '" + ". " * 100 + "'"
    assert toml_in(text)["a"] == {"b": {"c": 1}}


@each_of(
    "frequency",
    [
        [1.0, np.inf],
        [1.0, 1e308],
        np.inf,
        [-1.0],
        np.array(["2020-01-01"], dtype="M8[s]"),
        [1j],
        ["1"],
    ],
)
def test_what_is_no_frequency_is_refused_before_anything_is_computed(frequency):
    record = evaluated("gfl", restarts=0)
    asked = {
        "predict": lambda: ibrid.predict(record, "p=0.5,q=0", frequency),
        "stability": lambda: ibrid.stability(record, [2.0], frequency=frequency),
        "sweep": lambda: ibrid.sweep("paper_like", None, frequency),
        "response": lambda: record.response(next(iter(record.parameters)), frequency),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for ask in asked.values():
            with pytest.raises(IbridError, match="frequencies are numbers in Hz"):
                ask()
