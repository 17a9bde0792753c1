"""A kind that a user writes in a notebook works like those that ship, in this process and in any
other.
"""

import importlib.util
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import ibrid
from ibrid.errors import DiagramError
from ibrid.modules.vocabulary import VOCABULARY, find_kind

#: What a user types: a first-order filter by its time constant, where the shipped one has its
#: cutoff.
DECLARATION = """
from ibrid import VOCABULARY, ModuleKind, Range, Signal

def lag(tau):
    return [[-1 / tau]], [[1 / tau]], [[1]], [[0]]

MINE = ModuleKind(
    name="Lag",
    family="dynamic control",
    law="out = in_ / (1 + tau s)",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("lagged",),
    parameters={"tau": Range(1e-6, 1.0, 1e-3, "s", "time constant", divides=True)},
    state_space=lag,
    dc_gain=1.0,
    reference="a notebook",
)
"""
#: The benchmark with the user's filter before the PLL: as exact as with the shipped one.
PROGRAM = """
program = ibrid.program_text(ibrid.textbook("gfl_pll_filter_exact"))
diagram = ibrid.parse_program(program.replace('"LPF1", "pll_filter"', '"Lag", "pll_filter"'))
sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
"""


def notebook() -> dict:
    """The names that exist after running the cells in a notebook, whose module is called
    __main__.
    """
    names = {"__name__": "__main__", "ibrid": ibrid}
    exec(DECLARATION + PROGRAM, names)
    return names


def answer_of(script: str, folder: Path, stdin: bytes = b"") -> str:
    """What a fresh Python process prints when it runs the script as __main__."""
    path = folder / "script.py"
    path.write_text(script, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(path)], input=stdin, capture_output=True, cwd=folder, timeout=300
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode()


def test_an_own_kind_is_fitted_exactly():
    cells = notebook()
    record = ibrid.evaluate(
        cells["diagram"], cells["sweep"], vocabulary=(*VOCABULARY, cells["MINE"])
    )
    assert record.outcome == "ok"
    assert record.nrmse is not None
    assert record.nrmse < 1e-6  # clean data of the same structure
    op = cells["sweep"].names[0]
    assert record.parameters[op]["pll_filter.tau"] == pytest.approx(
        1 / (2 * 3.141592653589793 * 500), rel=1e-3
    )
    assert "pll_filter.lagged" in record.state_space(op).state_labels
    assert record.settings["vocabulary"] == "extended + Lag"


def test_a_record_with_an_own_kind_is_read_back_with_the_same_vocabulary(tmp_path: Path):
    cells = notebook()
    kinds = (*VOCABULARY, cells["MINE"])
    record = ibrid.evaluate(cells["diagram"], cells["sweep"], vocabulary=kinds)
    record.write(tmp_path / "record.json")
    again = ibrid.read_record(tmp_path / "record.json", kinds)
    op = cells["sweep"].names[0]
    assert (again.state_space(op).A == record.state_space(op).A).all()


def test_without_the_kind_the_program_is_refused_by_name():
    cells = notebook()
    record = ibrid.evaluate(cells["diagram"], cells["sweep"])
    assert record.outcome == "invalid"
    assert "Lag" in record.reasons[0]


def test_a_second_kind_of_a_known_name_is_refused():
    with pytest.raises(DiagramError, match="two kinds called Lag"):
        ibrid.evaluate(
            *(notebook()[name] for name in ("diagram", "sweep")),
            vocabulary=(notebook()["MINE"],) * 2,
        )


def test_the_shipped_kinds_survive_pickling():
    assert pickle.loads(pickle.dumps(VOCABULARY)) == VOCABULARY


@pytest.mark.slow
def test_a_record_survives_pickling():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    record = ibrid.evaluate(ibrid.textbook("naive"), sweep, restarts=0)
    again = pickle.loads(pickle.dumps(record))
    assert again.to_json() == record.to_json()
    assert again.vocabulary == VOCABULARY


@pytest.mark.nightly
def test_an_own_kind_in_a_script_reaches_a_spawned_process(tmp_path: Path):
    script = f"""
import multiprocessing

import ibrid

{DECLARATION}
{PROGRAM}
def score(kind):
    return ibrid.evaluate(diagram, sweep, vocabulary=VOCABULARY + (kind,)).nrmse

if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.apply(score, (MINE,)))
"""
    assert float(answer_of(script, tmp_path)) < 1e-6


@pytest.mark.nightly
def test_an_own_kind_in_a_notebook_reaches_a_fresh_process_by_cloudpickle(tmp_path: Path):
    cloudpickle = pytest.importorskip(
        "cloudpickle", reason="cloudpickle is not installed (pip install cloudpickle)"
    )
    cells = notebook()
    cargo = cloudpickle.dumps((cells["diagram"], cells["sweep"], (*VOCABULARY, cells["MINE"])))
    script = """
import pickle, sys
import ibrid

diagram, sweep, kinds = pickle.loads(sys.stdin.buffer.read())
record = ibrid.evaluate(diagram, sweep, vocabulary=kinds)
print(record.nrmse)
"""
    assert float(answer_of(script, tmp_path, cargo)) < 1e-6
    mine = find_kind("Lag", cloudpickle.loads(cargo)[2])
    assert mine.state_space(0.5) == cells["MINE"].state_space(0.5)


@pytest.mark.nightly
def test_an_own_kind_in_a_notebook_reaches_a_ray_worker(tmp_path: Path):
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    script = f"""
import os
os.environ.update(RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER="0", RAY_USAGE_STATS_ENABLED="0")
import ray
import ibrid

cells = {{"__name__": "__main__", "ibrid": ibrid}}
exec({DECLARATION + PROGRAM!r}, cells)
ray.init(address="local", num_cpus=1, include_dashboard=False, _node_ip_address="127.0.0.1", log_to_driver=False)
try:
    score = ray.remote(lambda diagram, sweep, kinds: ibrid.evaluate(diagram, sweep, vocabulary=kinds).nrmse)
    print(ray.get(score.remote(cells["diagram"], cells["sweep"], ibrid.VOCABULARY + (cells["MINE"],))))
finally:
    ray.shutdown()
"""
    assert float(answer_of(script, tmp_path).splitlines()[-1]) < 1e-6
