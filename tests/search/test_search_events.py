"""A search with records of events: they judge what the sweep does not tell apart, and the answer is fitted to both."""

import json

import numpy as np
import pytest
from ibrid_search.running import search
from sharing import shared

import ibrid
from ibrid.cli import main
from ibrid.measurement.event_csv import write_events
from ibrid.measurement.events import Events
from ibrid.plants.sweeping import plant_named
from ibrid.playback.recording import event_of, record_events
from ibrid.schemas import breach

INVERTER = "gfl_l_filter"


@shared
def events() -> Events:
    """A dip and a jump of the angle, with noise of 50 dB."""
    plant = plant_named(INVERTER)
    kinds = [event_of("dip:0.8,at=0.04,for=0.06"), event_of("phase:8,at=0.04")]
    return record_events(plant, plant.operating_points[:1], kinds, rate=3000.0, length=0.2, noise_db=50.0)


def noisy() -> ibrid.Sweep:
    clean = ibrid.read_sweep(ibrid.benchmarks()[INVERTER])
    return ibrid.add_noise(clean, 50.0, rng=np.random.default_rng(3))


def test_the_answer_is_fitted_to_both_and_the_selection_says_how_every_structure_does(tmp_path):
    folder = tmp_path / "run"
    run = search(noisy(), folder, start=ibrid.textbook(INVERTER), budget=5, events=events(), progress="silent")
    selection = json.loads((folder / "selection.json").read_text())
    assert breach(selection, "selection") is None
    judged = selection["events"]
    assert judged[0]["step"] == selection["answer"]
    assert [one["odds"] for one in judged] == sorted(one["odds"] for one in judged)
    assert len(judged) > 1
    assert run.best is not None
    names = set(events().names)
    assert set(run.best.nrmse_by_record) == names
    assert max(run.best.nrmse_by_record.values()) < 1.2 * 10**-2.5  # the noise
    assert set(ibrid.read_record(folder / "best.json").nrmse_by_record) == names
    with pytest.raises(ibrid.IbridError, match="the run was made with events"):
        search(noisy(), folder, start=ibrid.textbook(INVERTER), budget=5, resume=True, progress="silent")


def test_records_without_a_sweep_or_with_other_habits_are_one_sentence(tmp_path, capsys):
    file = tmp_path / "events.csv"
    write_events(events(), file)
    assert main(["search", str(file), "--out", str(tmp_path / "run")]) == 2
    assert "a search needs a sweep" in capsys.readouterr().err
    words = ["search", INVERTER, "--events", str(file), "--out", str(tmp_path / "run")]
    assert main([*words, "--parameters", "per-op"]) == 2
    assert "shared parameters" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
