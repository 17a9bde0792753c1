"""Set points that move: told in a file, taken by our own inverters, and played into the references
of a diagram.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid.cli import main
from ibrid.errors import IbridError, SweepError
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import Events
from ibrid.plants.sweeping import operating_point, plant_named
from ibrid.playback.compare import model_of_program, play
from ibrid.playback.recording import event_of, record_events


def recorded(name: str, *events: str, op: str = "p=0.6,q=0.1") -> Events:
    return record_events(
        plant_named(name), [operating_point(op)], [event_of(one) for one in events], length=0.6
    )


@pytest.mark.parametrize("name", ["paper_like", "gfl_l_filter", "gfm_droop", "gfm_vsm"])
def test_a_step_of_p_ref_is_answered_as_the_nonlinear_inverter_does(name: str):
    events, plant = recorded(name, "p_ref:0.65,at=0.2"), plant_named(name)
    model = model_of_program(ibrid.parse_program(plant.program), plant.diagram_values)
    playback = play(model, events)
    assert playback.nrmse is not None
    assert playback.nrmse < 5e-3  # a set point that rises within a millisecond, sampled at 5 kHz


def test_power_ends_where_it_is_told_to_and_reactive_power_where_it_was():
    record = recorded("gfl_l_filter", "p_ref:0.8,at=0.1").records[0]
    power = (record.v @ [1, 1j]) * np.conj(record.i @ [1, 1j])
    assert power[-1] == pytest.approx(0.8 + 0.1j, abs=5e-3)
    assert power[0] == pytest.approx(0.6 + 0.1j, abs=1e-6)


@pytest.mark.parametrize(("event", "step"), [("p_ref:0.7,at=0.1", 0.1), ("q_ref:0.2,at=0.1", 0.1j)])
def test_references_that_are_computed_from_power_move_with_it(event: str, step: complex):
    record = recorded("gfl_l_filter", event)
    values = {"plant.L_g": 0.1, "plant.R_g": 0.005}
    model = model_of_program(ibrid.textbook("gfl_dual_current"), values)
    played = play(model, record).records[0]
    assert played.current is not None
    i = played.current @ [1, 1j]
    e = played.record.v @ [1, 1j] + (0.005 + 0.1j) * i
    power = e * np.conj(i)  # at the capacitor, whose voltage the controller measures
    # 1/|e| is taken at rest, and q raises |e| by 1 %
    assert power[-1] - power[0] == pytest.approx(step, abs=3e-3)


def test_a_step_of_q_ref_is_played_too():
    events, plant = recorded("gfl_l_filter", "q_ref:0.3,at=0.2"), plant_named("gfl_l_filter")
    error = play(
        model_of_program(ibrid.parse_program(plant.program), plant.diagram_values), events
    ).nrmse
    assert error is not None
    assert error < 5e-3


def test_set_points_are_written_and_read_back(tmp_path: Path):
    events = recorded("gfl_l_filter", "p_ref:0.7,at=0.2", "dip:0.8,at=0.2")
    write_events(events, tmp_path / "a.csv")
    back = ibrid.read_events(tmp_path / "a.csv")
    np.testing.assert_allclose(
        back.records[0].told["p_ref"], events.records[0].told["p_ref"], atol=1e-12
    )
    assert not back.records[1].told
    assert back.records[0].rest_end == pytest.approx(0.2, abs=1e-3)


def test_set_points_in_si_are_of_the_base_of_powers(tmp_path: Path):
    time = np.arange(50) / 50.0
    lines = [
        "# f0_hz: 50",
        "# unit: si",
        "# s_base_va: 10e6",
        "# v_base_v: 20e3",
        "# window: none",
        "record,t,u,p,q,p_ref",
    ]
    lines += [
        f"a,{t!r},{20e3 / 3**0.5!r},{8e6 if t < 0.5 else 5e6},0,{8e6 if t < 0.48 else 5e6}"
        for t in time.tolist()
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    record = ibrid.read_events(tmp_path / "a.csv")["a"]
    np.testing.assert_allclose(record.told["p_ref"][[0, -1]], [0.8, 0.5])
    assert record.rest_end < 0.48
    assert record.steps_told["p_ref"][-1] == pytest.approx(-0.3)


def test_what_is_not_told_or_not_taken_is_a_sentence(tmp_path: Path):
    with pytest.raises(IbridError, match="gfm_droop is not told q_ref, it takes p_ref"):
        recorded("gfm_droop", "q_ref:0.3,at=0.2")
    events = recorded("gfl_l_filter", "p_ref:0.7,at=0.2")
    with pytest.raises(IbridError, match="nothing in the model compares it with a measured power"):
        play(model_of_program(ibrid.textbook("gfl_disturbance_observer"), {}), events)
    write_events(events, tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text().replace(",p_ref", ",v_ref")
    (tmp_path / "b.csv").write_text(text)
    model = model_of_program(ibrid.textbook("gfl"), {})
    with pytest.raises(
        IbridError, match=r"v_ref moves in record p_ref:0\.7; p_ref and q_ref are played"
    ):
        play(model, ibrid.read_events(tmp_path / "b.csv"))


def test_a_set_point_that_moves_within_the_rest_is_refused(tmp_path: Path):
    time = np.arange(50) / 50.0
    lines = ["# f0_hz: 50", "# window: none", "record,t,u,p,q,p_ref"]
    lines += [f"a,{t!r},1,0.8,0,{0.8 if t < 0.02 else 0.5}" for t in time.tolist()]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(SweepError, match="a set point moves within its rest"):
        ibrid.read_events(tmp_path / "a.csv")


def test_the_command_records_a_set_point(tmp_path: Path):
    out = tmp_path / "step.csv"
    asked = [
        "record",
        "gfl_l_filter",
        "--op",
        "p=0.6,q=0.1",
        "--event",
        "p_ref:0.8,at=0.2",
        "--out",
        str(out),
    ]
    assert main(asked) == 0
    assert "p_ref" in out.read_text()


def test_playback_says_how_the_set_point_is_followed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out, program = tmp_path / "step.csv", tmp_path / "model.py"
    program.write_text(plant_named("gfl_l_filter").program)
    asked = [
        "record",
        "gfl_l_filter",
        "--op",
        "p=0.6,q=0.1",
        "--event",
        "p_ref:0.8",
        "--length",
        "1",
        "--out",
        str(out),
    ]
    assert main(asked) == 0
    assert main(["playback", str(program), str(out), "--out", str(tmp_path / "a")]) == 0
    assert "settling (ms)" in capsys.readouterr().out
    assert (
        json.loads((tmp_path / "a" / "playback.json").read_text())["steps"]["p_ref:0.8"][
            "set_point"
        ]
        == "p_ref"
    )
    assert "Steps of set points" in (tmp_path / "a" / "report.html").read_text()
