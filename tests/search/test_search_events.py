"""A search with records of events: they judge what the sweep does not tell apart, and the answer is
fitted to both.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from ibrid_search.evaluation.assess import QUICK, Assessor
from ibrid_search.proposal import Evaluated
from ibrid_search.run.store import Store
from ibrid_search.running import search
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.watching.server import step_page
from sharing import shared

import ibrid
from ibrid.cli import main
from ibrid.gap.recordings.evaluation_record import simulate_events
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import Events
from ibrid.plants.sweeping import plant_named
from ibrid.playback.recording import event_of, record_events
from ibrid.schemas import breach
from ibrid.study import Study

INVERTER = "gfl_l_filter"


@shared
def events() -> Events:
    """A dip and a jump of the angle, with noise of 50 dB."""
    plant = plant_named(INVERTER)
    kinds = [event_of("dip:0.8,at=0.04,for=0.06"), event_of("phase:8,at=0.04")]
    return record_events(
        plant, plant.operating_points[:1], kinds, rate=3000.0, length=0.2, noise_db=50.0
    )


def noisy() -> ibrid.Sweep:
    clean = ibrid.read_sweep(ibrid.benchmarks()[INVERTER])
    return ibrid.add_noise(clean, 50.0, rng=np.random.default_rng(3))


@pytest.mark.nightly
def test_the_answer_is_fitted_to_both_and_the_selection_says_how_every_structure_does(tmp_path):
    folder = tmp_path / "run"
    run = search(
        noisy(),
        folder,
        start=ibrid.textbook(INVERTER),
        budget=5,
        events=events(),
        progress="silent",
    )
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
        search(
            noisy(),
            folder,
            start=ibrid.textbook(INVERTER),
            budget=5,
            resume=True,
            progress="silent",
        )


@pytest.mark.nightly
def test_records_alone_are_searched_from_a_start_and_the_page_plays_the_answer(tmp_path, capsys):
    file, folder = tmp_path / "events.csv", tmp_path / "run"
    write_events(events(), file)
    words = ["search", str(file), "--start", INVERTER, "--budget", "1", "--out", str(folder)]
    assert main(words) == 0
    answer = ibrid.read_record(folder / "best.json")
    assert ibrid.compare(answer.diagram, ibrid.textbook(INVERTER)).same
    assert set(answer.nrmse_by_record) == set(events().names)
    assert max(answer.nrmse_by_record.values()) < 1.2 * 10**-2.5  # the noise
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Records of events" in page
    assert "Records of events" in step_page(folder, 0)
    assert "no data" not in page
    assert main([*words[:-4], "--budget", "1", "--out", str(folder), "--resume"]) == 0
    assert main([*words[:-4], "--choose", "frequencies", "--out", str(tmp_path / "other")]) == 2
    assert "no frequencies" in capsys.readouterr().err


@pytest.mark.nightly
def test_a_run_that_goes_on_looks_for_no_starts_again(tmp_path, monkeypatch):
    folder, sweep = tmp_path / "run", noisy()
    search(sweep, folder, budget=7, progress="silent")
    monkeypatch.setattr("ibrid_search.running.rankings_of", None)
    assert search(sweep, folder, budget=8, resume=True, progress="silent").evaluations >= 7


@pytest.mark.nightly
def test_a_run_whose_list_of_starts_is_damaged_looks_for_them_again(tmp_path):
    folder, sweep = tmp_path / "run", noisy()
    search(sweep, folder, budget=7, progress="silent")
    with Store.open(folder / "archive.sqlite") as store:
        store.set_meta("starts", "{")
    assert search(sweep, folder, budget=8, resume=True, progress="silent").evaluations >= 7


@pytest.mark.slow
def test_a_record_with_a_held_out_event_that_its_simulation_leaves_can_be_read_again(
    tmp_path, monkeypatch
):
    def left(*given):
        playback = simulate_events(*given)
        records = [
            replace(one, nrmse=None) if one.record.name == "phase:8" else one
            for one in playback.records
        ]
        return replace(playback, records=tuple(records))

    monkeypatch.setattr("ibrid.gap.recordings.event_evaluation.simulate_events", left)
    study = Study.of(events(), holdout_op=("phase:8",))
    record = Assessor(study).record_of(ibrid.program_text(ibrid.textbook(INVERTER)), QUICK)
    assert record.outcome == "ok"
    record.write(tmp_path / "record.json")
    assert ibrid.read_record(tmp_path / "record.json").holdout == {}


@pytest.mark.nightly
def test_edits_that_race_on_records_have_the_filter_that_a_model_lacks_among_the_first_three():
    lacks = ibrid.textbook("gfl_exact")
    plant = plant_named("paper_like")
    kinds = [event_of("dip:0.8,at=0.04,for=0.06"), event_of("phase:8,at=0.04")]
    study = Study.of(
        record_events(
            plant, plant.operating_points[:1], kinds, rate=3000.0, length=0.2, noise_db=60.0
        )
    )
    record = Assessor(study).record_of(ibrid.program_text(lacks), QUICK)
    assert record.outcome == "ok"
    best = rankings_for(study).best_edits(Evaluated(0, lacks, record), lambda diagram: True, 3)
    assert "pll_prefilter" in [look.edit.source for look in best]
    assert rankings_for(study).locate_unknown_transfers(Evaluated(0, lacks, record)) == ()


@pytest.mark.nightly
def test_the_first_candidate_of_records_of_a_droop_inverter_is_its_diagram():
    plant = plant_named("gfm_droop")
    kinds = [event_of("dip:0.8,at=0.04,for=0.06"), event_of("phase:8,at=0.04")]
    study = Study.of(
        record_events(
            plant, plant.operating_points[:1], kinds, rate=3000.0, length=0.2, noise_db=50.0
        )
    )
    looks = rankings_for(study).screener.screen_library()
    assert ibrid.compare(looks[0].edit.diagram, ibrid.parse_program(plant.program)).same


def test_events_with_other_habits_are_one_sentence(tmp_path, capsys):
    file = tmp_path / "events.csv"
    write_events(events(), file)
    words = ["search", INVERTER, "--events", str(file), "--out", str(tmp_path / "run")]
    assert main([*words, "--parameters", "per-op"]) == 2
    assert "shared parameters" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_records_where_a_sweep_is_needed_are_called_what_they_are(tmp_path):
    write_events(events(), tmp_path / "events.csv")
    with pytest.raises(ibrid.IbridError, match="holds records of events, and a sweep is needed"):
        ibrid.read_sweep(tmp_path / "events.csv")
