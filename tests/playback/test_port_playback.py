"""Records behind a port: what lies between PCC and filter is part of the simulation, and of its
rest.
"""

import json
from pathlib import Path

import control
import numpy as np
import pytest

from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import read_record
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.sweeping import plant_named
from ibrid.playback.compare import model_of_program, nrmse, play
from ibrid.playback.limits import limit_named
from ibrid.playback.player import Player
from ibrid.playback.recording import event_of, record_events
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.network.outside import Outside, PortElement

PLANT = plant_named("paper_like")
VALUES = dict(PLANT.diagram_values)
POINT = OperatingPoint("it", 0.8, 0.1)
SHUNT = PortElement("shunt", {"R": 0.05, "C": 0.04})
BARE = PortElement("shunt", {"R": 0.0, "C": 0.02})
SERIES = PortElement("series", {"R": 0.004, "L": 0.06})
TRANSFORMER = PortElement("transformer", {"R": 0.003, "L": 0.05, "ratio": 1.04})
PORTS = {
    "a shunt at the PCC": (SHUNT,),
    "a shunt without resistance": (BARE,),
    "a series element": (SERIES,),
    "a transformer": (TRANSFORMER,),
    "two in series": (SERIES, TRANSFORMER),
    "a shunt behind a series element": (SERIES, SHUNT),
    "a shunt without resistance behind one": (SERIES, BARE),
    "a ladder": (BARE, SERIES, SHUNT, TRANSFORMER, SERIES),
}


def behind(*elements: PortElement):
    return parse_program(PLANT.program).behind(Outside(elements))


@pytest.mark.slow
@pytest.mark.parametrize("port", PORTS)
def test_a_small_step_is_answered_as_by_the_linear_model_behind_the_port(port: str):
    """Its state space is made apart (`assembly.terminals`), with Pade forms and rests of its
    own.
    """
    diagram = behind(*PORTS[port])
    time = np.arange(1500) / 5000
    v = np.stack(
        [event_of("step:1e-5,at=0.05,rise=0.02").voltage(time, 1.0).real, np.zeros(len(time))],
        axis=1,
    )
    rest = np.array([POINT.p, -POINT.q])
    record = EventRecord(POINT, time, v, np.tile(rest, (len(time), 1)), 0.05)
    (found,) = Player(diagram, VOCABULARY, (), 2 * np.pi * PLANT.f0_hz).play(record, [VALUES])
    sweep = Sweep(
        (PointSweep(POINT, np.ones(1), np.eye(2, dtype=complex)[None]),),
        f0_hz=PLANT.f0_hz,
        power_node="pcc",
    )
    linear = record_at(diagram, sweep, VALUES).state_space("it")
    answer = control.forced_response(linear, time, (v - v[0]).T).outputs.T
    # forced_response draws straight lines between samples: (pi/0.02)^2 (2e-4)^2 / 8 of the
    # voltage's slope, and its kinks
    assert (
        float(np.abs(found.current - rest - np.array(answer)).max() / np.abs(answer).max()) < 2e-4
    )


def test_a_series_port_is_a_longer_line_of_the_filter():
    events = record_events(PLANT, [POINT], [event_of("dip:0.6"), event_of("phase:15")], length=0.3)
    shorter = VALUES | {
        "plant.L_g": VALUES["plant.L_g"] - 0.06,
        "plant.R_g": VALUES["plant.R_g"] - 0.004,
    }
    error = play(model_of_program(behind(SERIES), shorter), events).nrmse
    assert error is not None
    assert error < 1e-6  # as without a port


def test_what_a_bare_shunt_takes_is_its_capacitance_times_the_slope_of_the_voltage():
    """i = C/omega_0 v' + C J v less what the resistance that a port never lacks, 1e-4, smooths:
    omega R C of it.
    """
    events = record_events(PLANT, [POINT], [event_of("dip:0.6")], length=0.3)
    record = events.records[0]
    taken = 0.02 * (
        record.voltage(record.time, 1) / (2 * np.pi * PLANT.f0_hz) + record.v @ [[0, 1], [-1, 0]]
    )
    moved = record.i - taken
    rest = OperatingPoint("it", float(moved[0, 0]), float(-moved[0, 1]))
    seen = EventRecord(rest, record.time, record.v, moved, record.rest_end)
    error = play(model_of_program(behind(BARE), VALUES), Events((seen,), f0_hz=PLANT.f0_hz)).nrmse
    assert error is not None
    assert error < 1e-4


def test_limits_act_behind_a_port_as_without_one():
    events = record_events(PLANT, [POINT], [event_of("dip:0.5")], length=0.3)
    limits = [limit_named("current_limit"), limit_named("pll_freeze")]
    told = {"current_limit.i_max": 1.0, "pll_freeze.v_freeze": 0.8}
    shorter = VALUES | {
        "plant.L_g": VALUES["plant.L_g"] - 0.06,
        "plant.R_g": VALUES["plant.R_g"] - 0.004,
    }
    (whole,) = Player(parse_program(PLANT.program), VOCABULARY, limits).play(
        events.records[0], [VALUES | told]
    )
    (port,) = Player(behind(SERIES), VOCABULARY, limits).play(events.records[0], [shorter | told])
    assert np.abs(whole.current - port.current).max() < 1e-5  # steps within which limits set in
    assert (nrmse(whole.current, events.records[0]) or 0.0) > 0.1


@pytest.mark.nightly
def test_a_port_file_is_taken_by_playback_and_by_a_fit_of_records(tmp_path: Path):
    events = record_events(
        PLANT, [POINT], [event_of("dip:0.7,for=0.06"), event_of("phase:15")], length=0.25
    )
    write_events(events, tmp_path / "dip.csv")
    (tmp_path / "model.py").write_text(PLANT.program)
    (tmp_path / "port.toml").write_text("""
        [[element]]
        kind = "series"
        unit = "pu"
        R = 0.004
        L = 0.06
        tolerance = 0.02
    """)
    shorter = VALUES | {
        "plant.L_g": VALUES["plant.L_g"] - 0.06,
        "plant.R_g": VALUES["plant.R_g"] - 0.004,
    }
    (tmp_path / "values.json").write_text(json.dumps(shorter))
    files = [str(tmp_path / name) for name in ("model.py", "dip.csv")]
    options = ["--values", str(tmp_path / "values.json"), "--port", str(tmp_path / "port.toml")]
    assert main(["playback", *files, *options, "--out", str(tmp_path / "played")]) == 0
    assert json.loads((tmp_path / "played/playback.json").read_text())["nrmse"] < 1e-6
    assert main(["evaluate", *files, *options, "--json", str(tmp_path / "fit.json")]) == 0
    record = json.loads((tmp_path / "fit.json").read_text())
    assert max(record["nrmse_by_record"].values()) < 1e-4
    (values,) = {json.dumps(one) for one in record["parameters"].values()}
    assert json.loads(values)["port.1.L"] == pytest.approx(0.06, rel=0.05)
    again = build_event_problem(read_record(tmp_path / "fit.json"), None, None, events, {}).prior()[
        "port.1.L"
    ]
    assert (again.nominal, again.tolerance) == (
        pytest.approx(0.06),
        0.02,
    )  # of the port file, not of the fit
    assert (
        main(
            [
                "predict",
                str(tmp_path / "fit.json"),
                "--events",
                files[1],
                "--out",
                str(tmp_path / "again.csv"),
            ]
        )
        == 0
    )


def test_doubted_labels_are_refused():
    with pytest.raises(IbridError, match="labels as they are"):
        Player(parse_program(PLANT.program).behind(Outside(labels=("power_scale",))), VOCABULARY)
