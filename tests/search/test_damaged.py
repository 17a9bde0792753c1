"""Records and runs of others, damaged anyhow, are read whole or refused in one sentence; `make attack` tries thousands."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_bench.attack.reading import plain, records_tried, runs_tried

import ibrid
from ibrid import cli
from ibrid.fit.settings import FitSettings
from ibrid.plants.benchmarks import benchmarks

DATA = str(benchmarks()["paper_like"])
OPTIONS = ("--proposer", "random", "--start", "naive", "--budget", "4", "--workers", "1", "--seed", "3")


def _held_out() -> ibrid.Record:
    noisy = ibrid.add_noise(benchmark(), 60.0, rng=np.random.default_rng(1), repeats=3)
    return ibrid.evaluate(ibrid.textbook("gfl_exact"), noisy, restarts=0, holdout_op="p=1,q=-0.3")


MADE = (
    partial(evaluated, "gfl_delay", restarts=0),
    partial(evaluated, "gfl_pll_filter", parameters="per-op", equilibrium="paper", vocabulary="paper", restarts=0),
    partial(evaluated, "gfl_exact", vocabulary="paper"),
    _held_out,
    lambda: ibrid.evaluate(ibrid.textbook("gfl"), benchmark(), settings=FitSettings(seconds=1e-3)),
)


def test_damaged_records_are_read_or_refused_in_a_sentence(tmp_path: Path):
    records = [plain(make()) for make in MADE]
    assert list(records_tried(records, tmp_path, 40, seed=1, commands=2)) == []


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "run"
    words = ["search", DATA, "--out", str(folder), *OPTIONS]
    assert cli.main(words) == 0
    return folder


def test_damaged_runs_are_read_or_refused_in_a_sentence(run: Path, tmp_path: Path):
    assert list(runs_tried(run, DATA, tmp_path, 16, seed=1, options=OPTIONS)) == []
