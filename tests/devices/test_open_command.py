"""`ibrid open`: what it refuses, each in one sentence, and what is kept of a device that stops."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from ibrid_search.opening import open_device
from ibrid_search.opening.open_device import _Opening, limits_of
from ibrid_search.opening.story import STORY, DeviceExperiment, OpeningStory, read_story
from ibrid_search.opening.structures import Structures
from model_files import DEVICE, GOOD

import ibrid
from ibrid.cli import main
from ibrid.evaluation.record import Record
from ibrid.playback.limits import limit_named
from ibrid.schemas import breach

#: A device whose set point never settles, and one that stops answering at its second set point.
RESTLESS = """
import numpy as np
class Inverter:
    p_ref = q_ref = 0.0
    def step(self, t, v_abc):
        return 0.5 * v_abc * (1 + 0.5 * np.sin(7 * t))
"""
STOPS = """
import time
class Inverter:
    p_ref = q_ref = 0.0
    def step(self, t, v_abc):
        if self.p_ref < 0.4:
            raise RuntimeError("no licence")
        v = v_abc
        turned = (v[[2, 0, 1]] - v[[1, 2, 0]]) / 3**0.5
        return self.p_ref * v + self.q_ref * turned
"""
PLAIN = 'kind = "python"\nfile = "model.py:Inverter"\nstep_s = 1e-3\n'
SIGNALS = '[signals]\np_ref = { name = "p_ref" }\nq_ref = { name = "q_ref" }\n'


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def device(text: str) -> None:
    Path("model.py").write_text(text)
    Path("DEVICE.toml").write_text(PLAIN + SIGNALS)


def refused(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """The last line that the command complains with."""
    assert main(["open", "DEVICE.toml", "--out", "run", *options]) == 2
    return capsys.readouterr().err.strip().splitlines()[-1]


def test_a_budget_that_the_coarse_sweep_uses_up_is_refused(capsys):
    Path("model.py").write_text(GOOD)
    Path("DEVICE.toml").write_text(DEVICE.format(more="", sign=1))
    assert "--budget must be 2 experiments or more" in refused(capsys, "--budget", "0")
    assert not Path("run").exists()


def test_a_folder_of_another_run_is_refused(capsys):
    device(STOPS)
    Path("run").mkdir()
    Path("run/archive.sqlite").write_text("of a search")
    assert "holds a run already" in refused(capsys)
    Path("run/archive.sqlite").unlink()
    Path("run/story.json").write_text("{}")
    assert "holds a story already" in refused(capsys)


def test_nothing_to_go_on_with_is_said(capsys):
    device(STOPS)
    assert "holds no story to go on with" in refused(capsys, "--resume")


def test_a_story_is_read_as_it_was_written_and_refused_when_edited():
    Path("run").mkdir()
    story = OpeningStory("key", "device", (DeviceExperiment("sweep", "p=0,q=0", "why"),))
    story.write(Path("run"))
    assert read_story(Path("run")) == story
    content = json.loads(Path("run", STORY).read_text())
    content["experiments"][0]["why"] = "another reason"
    Path("run", STORY).write_text(json.dumps(content))
    with pytest.raises(Exception, match="was changed; begin in another folder"):
        read_story(Path("run"))


@pytest.mark.slow
def test_a_set_point_that_never_settles_ends_in_a_sentence(capsys):
    device(RESTLESS)
    assert "must rest at p=0.8,q=0.2" in refused(capsys)


@pytest.mark.slow
def test_a_device_that_stops_in_the_middle_loses_no_measurement(capsys):
    device(STOPS)
    told = refused(capsys)
    assert "no licence" in told
    assert "what was measured is kept in run" in told
    kept = read_story(Path("run")).experiments
    assert [one.file for one in kept] == ["sweep_1.csv"]


@pytest.mark.nightly
def test_a_reference_inverter_is_opened_and_gone_on_with(capsys, monkeypatch):
    """Its own diagram is found, and what no fit saw is predicted."""
    Path("DEVICE.toml").write_text('kind = "reference"\nfile = "gfl_l_filter"\nstep_s = 1e-4\n')
    options = ["open", "DEVICE.toml", "--out", "run", "--budget", "4", "--effort", "low"]
    assert main(options) == 0
    assert "held-out step" in capsys.readouterr().out
    story = read_story(Path("run"))
    assert story.answer["grade"] == "explains"
    answer = ibrid.read_record("run/model.json").diagram
    assert ibrid.compare(answer, ibrid.textbook("gfl_l_filter")).same
    assert {*story.held_out} == {"sweep", "event", "step"}
    assert all(held_out["nrmse"] < 0.02 for held_out in story.held_out.values())
    content = json.loads(Path("run", STORY).read_text())
    assert breach(content, "open") is None
    assert "What was measured, and why" in Path("run/report.html").read_text()
    # nothing is measured twice, and the answer is the same
    monkeypatch.setattr(open_device, "measure_experiment", lambda *_: pytest.fail("measures again"))
    Path("run/report.html").unlink()
    assert main([*options, "--resume"]) == 0
    assert read_story(Path("run")) == story
    assert Path("run/report.html").is_file()


def test_a_limit_that_a_deep_dip_shows_is_told_by_its_name_and_values():
    limit = limit_named("current_limit", "magnitude", False).plain()
    fitted = {**limit, "parameters": {"i_max": 1.1}, "deviations": {"i_max": 0.01}}
    record = Record(outcome="ok", settings={"large_signal": [fitted]})
    assert limits_of(record) == {"current_limit": {"i_max": 1.1}}
    assert limits_of(replace(record, settings={})) == {}


@pytest.mark.parametrize("verdict", ["named", "unexplained"])
def test_the_answer_of_the_sweeps_is_kept_where_no_limit_explains_a_dip(monkeypatch, verdict):
    before = Record(outcome="ok", program="before")
    limit = {"id": "current_limit", "parameters": {"i_max": 1.1}}
    repaired = Record(outcome="ok", program="after", settings={"large_signal": [limit]})
    gap = SimpleNamespace(sentence="The device has a limit.", verdict=verdict, repaired=repaired)
    monkeypatch.setattr(open_device, "read_events", lambda _: None)
    monkeypatch.setattr(open_device, "played_error", lambda *_: 1.0)
    monkeypatch.setattr(open_device, "find_gap", lambda *_, **__: gap)
    dip = SimpleNamespace(refused="", file="dip.csv", event="dip:0.3")
    opening = SimpleNamespace(
        story=SimpleNamespace(experiments=[dip]),
        folder=Path(),
        effort="low",
        _data=lambda: (None, None),
        _heard=lambda *_: None,
        _note_answer=lambda *_: None,
    )
    found, told = _Opening._find_limits(opening, Structures(("hash",), (before,), ()))
    assert found.answer is (repaired if verdict == "named" else before)
    assert told.get("limits", {}) == (limits_of(repaired) if verdict == "named" else {})
