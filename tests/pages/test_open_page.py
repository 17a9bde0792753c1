"""The page of ibrid open: complete, self-contained, safe with what others wrote; and story.json."""

import json
from pathlib import Path

import pytest
from fitted import benchmark, evaluated
from ibrid_search.opening.open_device import MODEL, RECORD
from ibrid_search.opening.page import PAGE, RECORDINGS, write_page
from ibrid_search.opening.predicting import prediction_error
from ibrid_search.opening.story import STORY, DeviceExperiment, OpeningStory
from jsonschema import Draft202012Validator
from page_reader import Reader, self_contained

import ibrid
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.formats.event_csv import write_events
from ibrid.plants import PLANTS, frequency_grid, operating_point
from ibrid.playback.recording import event_of, record_events
from ibrid.schemas import schema
from ibrid.structure.diagrams.library import textbook_text

HOSTILE = '<script>alert("x")</script>&'
OP = "p=0.6,q=0.1"


def a_story(folder: Path) -> OpeningStory:
    """Of the benchmark's inverter, with all that a story can hold."""
    answer = evaluated("gfl_pll_filter_exact", restarts=0)
    write_sweep(
        ibrid.sweep("paper_like", [operating_point(OP)], frequency_grid("10:1000:12")),
        folder / "s.csv",
    )
    events = record_events(PLANTS["paper_like"], [operating_point(OP)], [event_of("dip:0.9")])
    write_events(events, folder / "e.csv")
    write_events(events, folder / RECORDINGS)
    fitted = {"answer": answer.program, "grade": answer.grade, "nrmse": answer.nrmse}
    first = DeviceExperiment(
        "sweep",
        "p=1,q=0.3",
        f"the coarse sweep of {HOSTILE}",
        frequencies=(10.0, 20.0),
        simulated_s=70.0,
        ruled_out=(f"{HOSTILE}: fails",),
        answer=textbook_text("gfl_exact"),
        grade="rough",
        nrmse=0.1,
    )
    second = DeviceExperiment(
        "event", OP, "it decides between a and b", "dip:0.7", separates=(("a", "b", 3.0),), **fitted
    )
    third = DeviceExperiment("sweep", "p=9,q=9", "it tells most", refused="does not rest there")
    told = {
        "program": answer.program,
        "grade": answer.grade,
        "nrmse": answer.nrmse,
        "rivals": ["0123456789"],
        "limits": {
            "sentence": "the current is limited",
            "nrmse": 0.3,
            "verdict": "named",
            "limits": {"current_limit.i_max": 1.2, "current_limit.mode": "magnitude"},
        },
        "model": MODEL,
        "record": RECORD,
    }
    held_out = {}
    for name, event, file in (("sweep", "", "s.csv"), ("event", "dip:0.9", "e.csv")):
        kind = "event" if event else "sweep"
        error = prediction_error(answer, folder / file, kind)
        held_out[name] = {"op": OP, "event": event, "file": file, "nrmse": error, "refused": ""}
    held_out["step"] = {"op": OP, "event": "p_ref:0.7", "nrmse": None, "refused": "no such input"}
    return OpeningStory(
        "key", f"a device {HOSTILE}", (first, second, third), "it is enough", told, held_out
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """With the story and its page."""
    place = tmp_path_factory.mktemp("opened")
    story = a_story(place)
    story.write(place)
    write_page(story, evaluated("gfl_pll_filter_exact", restarts=0), benchmark(), place)
    return place


@pytest.fixture(scope="module")
def reader(folder) -> Reader:
    return self_contained((folder / PAGE).read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_page_tells_the_whole_story(reader: Reader):
    text = " ".join(" ".join(reader.words).split())
    wanted = (
        "What was measured, and why",
        "It decides between a and b",
        "Not measured: Does not rest there",
        "How the diagram grew",
        "after experiment 1",
        "after experiment 2",
        "The current is limited",
        "current_limit.i_max",
        "Held out",
        "p_ref:0.7 at p=0.6,q=0.1: no such input",
        "ibrid export",
        "ibrid generic",
        "ibrid stability",
        "1 rival left",
        "It ended because it is enough.",
    )
    assert [words for words in wanted if words not in text] == []


@pytest.mark.slow
def test_what_a_device_file_says_stays_text(reader: Reader):
    assert sum(HOSTILE in words for words in reader.words) >= 3


@pytest.mark.slow
def test_held_out_experiments_are_drawn(reader: Reader):
    names = {attributes.get("id", "") for attributes in reader.all("svg")}
    drawn = " ".join(attributes.get("aria-label") or "" for attributes in reader.all("svg"))
    assert names
    assert "held out" in drawn
    assert "dip:0.9" in drawn


@pytest.mark.slow
def test_a_fit_of_the_true_structure_predicts_what_it_did_not_see(folder: Path):
    """The benchmark's sweep is exact up to the rounding of the fit."""
    held_out = json.loads((folder / STORY).read_text())["held_out"]
    assert held_out["sweep"]["nrmse"] < 1e-3
    assert held_out["event"]["nrmse"] < 1e-2


@pytest.mark.slow
def test_the_schema_describes_a_story(folder: Path):
    checks = Draft202012Validator(schema("open"))
    content = json.loads((folder / STORY).read_text())
    assert [error.message for error in checks.iter_errors(content)] == []
    begun = OpeningStory("key", "device").to_json()
    assert [error.message for error in checks.iter_errors(begun)] == []
    for change in ({"answer": {"grade": "fine"}}, {"held_out": {"other": {}}}, {"schema": "x"}):
        assert list(checks.iter_errors(content | change)) != []
