"""Text of files is shown and not obeyed: on the terminal, in pages and other files, in notebooks,
in spreadsheets.
"""

import re
import unicodedata
from dataclasses import replace
from pathlib import Path

import pytest

from ibrid import cli
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.fit.settings import FitSettings
from ibrid.foreign_text import ACTING, cell_meant, csv_text, show_controls, show_controls_within
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.read import read_sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.report.texts.text import format_record
from ibrid.structure.diagrams.library import textbook

RED, SHOWN = "\x1b[31m", r"\x1b[31m"

SWEEP = """\
# a laboratory: bench 3
# unit: pu
# current: out
# power_node: pcc
op,p,q,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im,note
near,1,0.3,5,-0.3,0.4,0.1,0,-0.1,0,0.9,0.2,good
near,1,0.3,50,-0.2,0.5,0.1,0,-0.1,0,0.8,0.3,good
near,1,0.3,500,-0.1,0.6,0.1,0,-0.1,0,0.7,0.4,good
"""
TOUCHSTONE = """\
! a laboratory
# Hz Y RI R 1
5 -0.3 0.4 0.1 0 -0.1 0 0.9 0.2
50 -0.2 0.5 0.1 0 -0.1 0 0.8 0.3
"""
META = "p: 1\nq: 0.3\nop: near\nunit: pu\ncurrent: out\n"
NETWORK = """\
# a port
power_node = "outside"
[[element]]
kind = "series"
unit = "pu"
R = 0.01
L = 0.05
"""
PROGRAM = '''\
def build_gain(g):
    """A gain."""
    g.add("LFilter", "plant")  # the filter
    g.add("Gain_dq", "gain", k="share")
    g.add("ConstZero", "still")
    g.connect("v_DQ", "plant.v_in")
    g.connect("v_DQ", "gain.in_")
    g.connect("gain.out", "plant.u_r")
    g.connect("still.out", "plant.delta_omega")
    g.connect("plant.i_g", "i_DQ")
'''
EVENTS = """\
# a recorder: bench 3
# f0_hz: 50
# power_node: pcc
record,t,v_d,v_q,i_d,i_q
dip,0.000,1.0,0.0,0.5,0.1
dip,0.001,1.0,0.0,0.5,0.1
dip,0.002,0.7,0.0,0.6,0.2
dip,0.003,0.7,0.0,0.6,0.2
"""
COMTRADE = """\
STATION,RECORDER,1999
6,6A,0D
1,UA,A,line,V,1,0,0,-99999,99999,1,1,P
2,UB,B,line,V,1,0,0,-99999,99999,1,1,P
3,UC,C,line,V,1,0,0,-99999,99999,1,1,P
4,IA,A,line,A,1,0,0,-99999,99999,1,1,P
5,IB,B,line,A,1,0,0,-99999,99999,1,1,P
6,IC,C,line,A,1,0,0,-99999,99999,1,1,P
50
1
1000,4
01/01/2020,00:00:00.000000
01/01/2020,00:00:00.001000
ASCII
1
"""
SAMPLES = "".join(f"{k},{k * 1000},325,-162,-162,10,-5,-5\n" for k in range(1, 5))
#: The sweep without the column that nobody knows.
MEASURED = re.sub(",note|,good", "", SWEEP)
FIT = ["evaluate", "naive", "FOLDER/sweep.csv", "--restarts", "0"]
LOOK = ["inspect", "FILE", "--json", "OUT/look.json"]
#: Name of a form of file: its text, the file, the words of a command, and files that lie beside it.
FORMS: dict[str, tuple[str, str, list[str], dict[str, str]]] = {
    "sweep": (SWEEP, "sweep.csv", LOOK, {}),
    "imported": (
        SWEEP,
        "sweep.csv",
        ["import", "FILE", "--f0-hz", "50", "--q-axis", "leads", "--out", "OUT/s.csv"],
        {},
    ),
    "touchstone": (TOUCHSTONE, "sweep.s2p", LOOK, {"sweep.s2p.meta": META}),
    "meta": (META, "sweep.s2p.meta", ["inspect", "FOLDER/sweep.s2p"], {"sweep.s2p": TOUCHSTONE}),
    "program": (PROGRAM, "model.py", ["check", "FILE"], {}),
    "network": (NETWORK, "port.toml", [*FIT, "--port", "FILE"], {"sweep.csv": MEASURED}),
    "events": (EVENTS, "events.csv", LOOK, {}),
    "comtrade": (COMTRADE, "dip.cfg", [*LOOK, "--base", "10kVA,400V"], {"dip.dat": SAMPLES}),
}


def written(folder: Path) -> bytes:
    """All that lies in a folder."""
    return b"".join(path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file())


def filled(word: str, places: dict[str, Path]) -> str:
    """A word of a command with the places it names."""
    return re.sub("|".join(places), lambda found: str(places[found[0]]), word)


def shown_of(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What a command prints on both streams; it knows what went wrong, if anything did."""
    capsys.readouterr()
    assert cli.main(words) in (0, 2), words
    told = capsys.readouterr()
    return told.out + told.err


@pytest.mark.nightly
@pytest.mark.parametrize("form", FORMS)
def test_an_escape_in_any_word_of_a_file_reaches_neither_terminal_nor_file(form, tmp_path, capsys):
    text, name, command, beside = FORMS[form]
    if form == "comtrade":
        pytest.importorskip(
            "comtrade", reason="COMTRADE files are read by comtrade (pip install 'ibrid[comtrade]')"
        )
    told = 0
    words_of = {word[0]: word for word in re.finditer(r"[A-Za-z_]+", text)}
    every = (
        6 if form == "comtrade" else 1
    )  # its reader has a process of its own, which takes a second to begin
    for number, word in enumerate(list(words_of.values())[::-every]):
        folder, out = tmp_path / f"{number}", tmp_path / f"{number}" / "out"
        out.mkdir(parents=True)
        for other, content in beside.items():
            (folder / other).write_text(content, encoding="utf-8")
        (folder / name).write_text(text[: word.end()] + RED + text[word.end() :], encoding="utf-8")
        words = [
            filled(one, {"FILE": folder / name, "FOLDER": folder, "OUT": out}) for one in command
        ]
        shown = shown_of(words, capsys)
        assert "\x1b" not in shown, (form, word[0])
        assert b"\x1b" not in written(out), (form, word[0])
        told += r"\x1b" in shown
    assert told, "no word of the file is ever shown, and nothing is tested"


@pytest.mark.parametrize(
    "words", [[f"a{RED}"], ["check", "gfl", f"--a{RED}"], ["inspect", f"a{RED}.csv"]]
)
def test_an_escape_in_the_words_of_a_command_is_shown(words, capsys):
    assert SHOWN in shown_of(words, capsys)


@pytest.mark.slow
def test_a_file_with_an_escape_in_its_name_is_shown_in_every_answer(tmp_path, capsys):
    data = tmp_path / f"sweep{RED}\u202e.csv"
    data.write_text(MEASURED, encoding="utf-8")
    places = [str(tmp_path / "out" / name) for name in ("fit.json", "fit.html", "p.csv")]
    (tmp_path / "out").mkdir()
    fit = [
        "evaluate",
        "naive",
        str(data),
        "--restarts",
        "0",
        "--json",
        places[0],
        "--report",
        places[1],
    ]
    shown = shown_of(fit, capsys) + shown_of(["report", places[0]], capsys)
    shown += shown_of(
        ["predict", places[0], "--op", "near", "--freq", "5:50:2", "--out", places[2]], capsys
    )
    assert SHOWN in shown
    assert not {"\x1b", "\u202e"} & set(shown + written(tmp_path / "out").decode("utf-8"))
    assert SHOWN in Path(places[1]).read_text(encoding="utf-8")
    record = evaluate(textbook("naive"), read_sweep(data), settings=FitSettings(restarts=0))
    assert not {"\x1b", "\u202e"} & set(record._repr_html_())


@pytest.mark.slow
def test_what_acts_is_shown_and_what_is_seen_stays():
    acting = "".join(map(chr, range(0x110000)))
    shown = show_controls(acting)
    assert {one for one in shown if unicodedata.category(one) in ACTING} == {"\n", "\t"}
    assert show_controls("größer 漢 ±\n\t") == "größer 漢 ±\n\t"
    assert show_controls("\x1b \x9b \u202e \udcff") == r"\x1b \x9b \u202e \xff"
    assert show_controls_within({"a\x1b": ["\x07", 1.5, None]}) == {r"a\x1b": [r"\x07", 1.5, None]}


def test_an_error_shows_what_it_names():
    assert str(IbridError(f"there is no {RED}")) == f"there is no {SHOWN}"


@pytest.mark.parametrize("cell", ["=1+1", "+a", "-a", "@a", "\t=1", "- b"])
def test_no_cell_begins_a_formula_and_reading_takes_the_mark_away(cell):
    (line,) = csv_text([[cell, "end"]]).splitlines()
    assert line.startswith(("'", "\"'"))
    assert cell_meant(f"'{cell}") == cell


@pytest.mark.parametrize("cell", ["-1.5", "+2", "-1e-3", -1.5, "a=b", "it's", "'a'", "p=1,q=-0.3"])
def test_numbers_and_names_stay_as_they_are(cell):
    assert csv_text([[cell]]).strip().strip('"') == str(cell)
    assert cell_meant(str(cell)) == str(cell)


@pytest.mark.parametrize("cell", ["a;=1+1", "a\t@SUM(1)", "a; +cmd", "=a;=b", "＝1+1", "a;＠b"])
def test_no_cell_begins_a_formula_where_semicolons_or_tabs_part_cells(cell):
    (line,) = csv_text([[cell, "end"]]).splitlines()
    for separator in ",;\t":
        assert not any(re.match(r"[\s\"]*[=+@＝＠-]", one) for one in line.split(separator))
    assert cell_meant(line.removesuffix(",end").strip('"')) == cell
    assert csv_text([["a;b", "a;-1.5", "a;'c"]]) == "a;b,a;-1.5,a;'c\n"
    assert [cell_meant(one) for one in ("a;b", "a;-1.5", "a;'c")] == ["a;b", "a;-1.5", "a;'c"]


def test_no_comment_holds_a_cell_that_begins_a_formula():
    assert csv_text([], ["# a,=b,-1.5,@c"]) == "# a, '=b,-1.5, '@c\n"
    assert csv_text([], ["# a;=b;-1.5;+c"]) == "# a; '=b;-1.5; '+c\n"


def test_a_sweep_with_a_formula_for_a_name_is_written_harmless_and_read_as_it_was(tmp_path):
    (tmp_path / "sweep.csv").write_text(
        MEASURED.replace("near", "=near").replace("# current", "# a,=b\n# current")
    )
    sweep = read_sweep(tmp_path / "sweep.csv")
    write_sweep(sweep, tmp_path / "again.csv")
    text = (tmp_path / "again.csv").read_text(encoding="utf-8")
    assert not re.search(r"(^|,)=", text, re.MULTILINE)
    assert read_sweep(tmp_path / "again.csv").names == sweep.names == ("=near",)


def test_the_text_of_a_record_from_python_is_shown():
    quick = FitSettings(starts=8, kept=1, kept_misfit=1, restarts=0, hops=0)
    record = evaluate(textbook("naive"), read_sweep(benchmarks()["paper_like"]), settings=quick)
    text = format_record(replace(record, warnings=(f"{RED}\u202e",)))
    assert f"{SHOWN}\\u202e" in text
    assert "\x1b" not in text


def test_a_refusal_says_no_more_of_a_long_word_than_its_beginning():
    with pytest.raises(IbridError) as refused:
        textbook("a" * 1_000_000)
    assert len(str(refused.value)) < 1_000
