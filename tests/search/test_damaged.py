"""Records, runs and events of others, damaged anyhow, are read or refused in one sentence; `make
attack` tries thousands.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_bench.attack.reading import events_tried, plain, records_tried, runs_tried
from ibrid_search.run.selection import read_selection

import ibrid
from ibrid import cli
from ibrid.errors import IbridError
from ibrid.plants.benchmarks import benchmarks
from ibrid.schemas import breach

DATA = str(benchmarks()["paper_like"])
OPTIONS = (
    "--proposer",
    "random",
    "--start",
    "naive",
    "--budget",
    "4",
    "--workers",
    "1",
    "--seed",
    "3",
)


def _held_out() -> ibrid.Record:
    noisy = ibrid.add_noise(benchmark(), 60.0, rng=np.random.default_rng(1), repeats=3)
    return ibrid.evaluate(ibrid.textbook("gfl_exact"), noisy, restarts=0, holdout_op="p=1,q=-0.3")


MADE = (
    partial(evaluated, "gfl_delay", restarts=0),
    partial(
        evaluated,
        "gfl_pll_filter",
        parameters="per-op",
        equilibrium="paper",
        vocabulary="paper",
        restarts=0,
    ),
    partial(evaluated, "gfl_exact", vocabulary="paper"),
    _held_out,
)


@pytest.mark.nightly
def test_damaged_records_are_read_or_refused_in_a_sentence(tmp_path: Path):
    records = [plain(make()) for make in MADE]
    assert list(records_tried(records, tmp_path, 40, seed=1, commands=2)) == []


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "run"
    words = ["search", DATA, "--out", str(folder), *OPTIONS]
    assert cli.main(words) == 0
    return folder


@pytest.mark.nightly
def test_damaged_runs_are_read_or_refused_in_a_sentence(run: Path, tmp_path: Path):
    assert list(runs_tried(run, DATA, tmp_path, 16, seed=1, options=OPTIONS)) == []


@pytest.mark.slow
def test_a_selection_is_as_its_schema_says_and_a_number_beyond_every_float_is_a_sentence(
    run: Path, tmp_path: Path
):
    found = json.loads((run / "selection.json").read_text())
    assert breach(found, "selection") is None
    found["front"][0]["damping"] = 10**400
    (tmp_path / "selection.json").write_text(json.dumps(found))
    with pytest.raises(IbridError, match=r"damping.*; finish the run again$"):
        read_selection(tmp_path / "selection.json")


@pytest.mark.nightly
def test_damaged_events_are_played_or_refused_in_a_sentence(tmp_path: Path):
    events = tmp_path / "events.csv"
    told = ["--event", "dip:0.6,at=0.05,for=0.05", "--length", "0.15", "--rate", "2000"]
    assert cli.main(["record", "paper_like", "--op", "p=1,q=0.3", *told, "--out", str(events)]) == 0
    assert list(events_tried(events, tmp_path, 40, seed=4)) == []
