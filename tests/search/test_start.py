"""`ibrid start`: from a file to a first answer, its page, its model and the commands that go on."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from browser import asked
from foreign_files import MAKES
from jsonschema import Draft202012Validator
from page_reader import self_contained

import ibrid
from ibrid import cli
from ibrid.measurement.csv_file import write_sweep
from ibrid.schemas import schema


@pytest.fixture(scope="module")
def started(tmp_path_factory) -> Path:
    """The folder of a start on a device that ships, with 1 % noise."""
    folder = tmp_path_factory.mktemp("start")
    measured = ibrid.add_noise(
        ibrid.read_sweep(ibrid.benchmarks()["paper_like"]), noise_db=40, repeats=4, rng=np.random.default_rng(1)
    )
    write_sweep(measured, folder / "data.csv")
    assert cli.main(["start", str(folder / "data.csv"), "--out", str(folder / "out")]) == 0
    return folder


def test_the_shipped_diagram_that_made_the_data_is_first_and_graded(started):
    answer = json.loads((started / "out/start.json").read_text())
    assert [error.message for error in Draft202012Validator(schema("start")).iter_errors(answer)] == []
    best, *others = answer["ranked"]
    assert (best["diagram"], best["grade"]) == ("gfl_pll_filter_exact", "explains")
    assert max(best["held_out"].values()) < 0.03  # the noise of one run is 1 %
    assert all(other["grade"] in ("rough", "fails", "close", "explains", None) for other in others)
    assert len(others) > 20
    assert answer["family"] == "grid-following, a PLL gives its angle"


def test_the_next_commands_can_be_pasted(started):
    answer = json.loads((started / "out/start.json").read_text())
    assert len(answer["next"]) == 3
    parser = cli.parser()
    for line in answer["next"]:
        program, *words = shlex.split(line)
        assert program == "ibrid"
        parser.parse_args(words)
    assert ibrid.read_record(started / "out/model.json").nrmse == pytest.approx(answer["ranked"][0]["nrmse"])
    assert ibrid.read_program(started / "out/model.py").instances


def test_the_page_begins_with_the_sentence_the_grade_and_the_diagram(started):
    answer = json.loads((started / "out/start.json").read_text())
    text = (started / "out/report.html").read_text()
    assert text.index(answer["sentence"].split(":")[0]) < text.index('id="diagram"') < text.index('id="next"')
    self_contained(text)


def test_the_first_screen_of_a_telephone_has_sentence_grade_and_diagram(started, tmp_path):
    page = (started / "out/report.html").read_text()
    question = """
    const wide = document.documentElement.scrollWidth, svg = document.querySelector("svg.diagram");
    const sections = [...document.querySelectorAll("main section")].map((one) => one.id);
    return [wide <= window.innerWidth, document.querySelector("header h1").textContent.trim(), sections[0],
            svg.getBoundingClientRect().width > 0, document.querySelectorAll(".zoombar").length];
    """
    ((narrow, title, first, drawn, bars),), console = asked([page], question, tmp_path)
    assert narrow
    assert title == "gfl_pll_filter_exact"
    assert (first, drawn, bars) == ("diagram", True, 1)
    assert not [line for line in console if "Error" in line or "Content Security" in line]


def test_a_foreign_table_that_says_everything_is_started_on_as_it_is(tmp_path, capsys):
    """And one that does not is refused with what to say."""
    truth = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    makes = {make.make: make for make in MAKES}
    (file,) = makes["tidy rows"].write(truth, tmp_path)
    assert cli.main(["start", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "--unit pu or --unit S" in capsys.readouterr().err
