"""A generic model fitted to an identified one: what it is judged by, and where it is blind."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ibrid
from ibrid import cli
from ibrid.errors import IbridError
from ibrid.generic.blind_bands import blind_bands
from ibrid.generic.dialect import DIALECTS
from ibrid.generic.fit import fit_generic
from ibrid.generic.model import MODELS
from ibrid.generic.seen import seen_events
from ibrid.generic.standard_events import FITTED, HELD_OUT, answers_to_standard_events
from ibrid.measurement import OperatingPoint
from ibrid.plants.sweeping import plant_named
from ibrid.playback.compare import PlayedRecord, model_of_program

MODEL = MODELS["wecc_regc_a+reec_a"]
POINT = OperatingPoint("rest", 0.8, 0.1)


@pytest.fixture(scope="module")
def answers():
    plant = plant_named("gfl_l_filter")
    detailed = model_of_program(ibrid.parse_program(plant.program), plant.diagram_values)
    return answers_to_standard_events(detailed, [POINT], plant.f0_hz)


def test_an_identified_model_rests_at_its_powers_and_follows_its_set_points(answers):
    assert answers.left_out == ()
    assert (len(answers.fitted.records), len(answers.held_out.records)) == (
        len(FITTED),
        len(HELD_OUT),
    )
    for record in answers.fitted.records:
        power = record.v @ [1, 1j] * np.conj(record.i @ [1, 1j])
        assert power[0] == pytest.approx(0.8 + 0.1j, abs=1e-6)
        moved = {"p_ref:0.6": 0.6 + 0.1j, "q_ref:0.2": 0.8 + 0.2j}.get(record.name, 0.8 + 0.1j)
        assert power[-1] == pytest.approx(moved, abs=5e-3)


def test_a_current_that_is_whole_in_dips_is_found_where_least_squares_does_not_lead(answers):
    """The law played as the device: Lvpnt1 = 0.3, so that no event reduces the active current."""
    true = {**MODEL.typical, "Lvpnt1": 0.3, "Lvpnt0": 0.1, "Tg": 0.03, "Imax": 1.8}
    wecc = DIALECTS["wecc"]
    records = []
    for seen in seen_events(answers.fitted):
        current = seen.current(lambda t, v, told, rest: MODEL.play(true, wecc, t, v, told, rest))
        i = np.stack([current.real, current.imag], axis=1)
        records.append(replace(seen, record=replace(seen.record, i=i)))
    fit = fit_generic(MODEL, records)
    assert fit.squares < 1.0
    assert fit.values["Tg"] == pytest.approx(0.03, rel=0.02)
    assert fit.values["Lvpnt1"] < 0.55


def test_a_swing_that_the_model_lacks_is_told_with_its_band(answers):
    record = answers.fitted.records[0]
    departure = np.linalg.norm(record.i - record.i_rest) / np.sqrt(len(record.time))
    swing = 0.3 * np.sqrt(2) * departure * np.sin(2 * np.pi * 5 * record.time)
    current = record.i + np.stack([swing, 0 * swing], axis=1)
    found = list(blind_bands(PlayedRecord(record, current, None, 0.3, {}, {})))
    strongest = max(found, key=lambda one: one.left)
    assert (strongest.low_hz, strongest.high_hz) == (2.0, 8.0)
    assert strongest.left == pytest.approx(0.3, rel=0.1)
    assert list(blind_bands(PlayedRecord(record, record.i, None, 0.0, {}, {}))) == []


@pytest.mark.slow
def test_a_record_becomes_a_generic_model_with_errors_of_events_that_no_fit_saw(tmp_path):
    record = ibrid.evaluate("gfl_l_filter", "gfl_l_filter")
    record.write(tmp_path / "model.json")
    out = tmp_path / "generic"
    command = ["generic", str(tmp_path / "model.json"), "--op", "p=0.8,q=0.1", "--out", str(out)]
    assert cli.main(command) == 0
    written = json.loads((out / "generic.json").read_text())
    held_out = written["nrmse_held_out"]
    assert len(held_out) == len(HELD_OUT)
    assert max(held_out.values()) < 0.15
    assert all(one["left"] > 0.05 for one in written["cannot_show"])
    assert "REGCA1" in (out / "model.dyr").read_text()
    answer = ibrid.generic_model(record, points=[OperatingPoint("rest", 0.8, 0.1)])
    assert {one.record.name: one.nrmse for one in answer.held_out} == pytest.approx(held_out)
    assert len(answer.to_dataframe()) == len(answer.rows())
    assert "held out" in answer._repr_html_()
    assert "GenericAnswer" in repr(answer)


def test_what_is_neither_a_recording_nor_a_record_is_said():
    with pytest.raises(IbridError, match="found Sweep"):
        ibrid.generic_model(ibrid.benchmarks()["paper_like"])


def test_operating_points_are_refused_beside_recordings(answers):
    with pytest.raises(IbridError, match="recordings bring their own"):
        ibrid.generic_model(answers.fitted, points=[POINT])
