"""The Python of a study engineer and of a notebook: data frames in and out, short words,
pictures.
"""

import importlib
import inspect
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest
from made_gap import made
from matplotlib.figure import Figure

import ibrid


@pytest.fixture(scope="module")
def record() -> ibrid.Record:
    return ibrid.evaluate(
        ibrid.textbook("gfl_pll_filter_exact"), ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    )


@pytest.mark.nightly
def test_the_script_of_a_study_engineer_runs(tmp_path: Path, monkeypatch):
    """Fifteen lines: a colleague's table, a fit, what it says, a weak grid, a model to take
    away.
    """
    monkeypatch.chdir(tmp_path)
    frame = ibrid.read_sweep(ibrid.benchmarks()["paper_like"]).to_dataframe()
    frame = frame.rename(columns={"freq_hz": "f (Hz)", "op": "Case"})
    sweep = ibrid.read_sweep(
        frame, unit="pu", f0_hz=60, current="out", q_axis="leads", power_node="capacitor"
    )
    name = sweep.names[0]
    assert sweep[name].admittance.shape == (16, 2, 2)
    fit = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep)
    assert fit.nrmse is not None
    assert fit.nrmse < 1e-6
    study = ibrid.stability(fit, scr=[2.0, 5.0])
    fit.plot().savefig("fit.png")
    study.plot().savefig("poles.png")
    ibrid.export(fit, "model.json", "control-json", name)
    elsewhere = ibrid.predict(fit, "p=0.5,q=0", frequency=np.geomspace(5, 5000, 20))
    elsewhere.plot().savefig("elsewhere.png")
    assert {"fit.png", "poles.png", "elsewhere.png", "model.json"} <= {
        path.name for path in tmp_path.iterdir()
    }


def test_a_data_frame_and_arrays_come_back_as_they_went():
    sweep = ibrid.add_noise(
        ibrid.read_sweep(ibrid.benchmarks()["gfm_droop"]),
        noise_db=40,
        repeats=3,
        rng=np.random.default_rng(0),
    )
    again = ibrid.read_sweep(sweep.to_dataframe())
    assert (again.f0_hz, again.power_node, again.names) == (
        sweep.f0_hz,
        sweep.power_node,
        sweep.names,
    )
    for point in sweep.points:
        np.testing.assert_allclose(again[point.op.name].admittance, point.admittance, rtol=1e-14)
        np.testing.assert_allclose(again[point.op.name].sigma, point.sigma, rtol=1e-12)
    first = sweep.points[0]
    arrays = ibrid.read_sweep((first.frequency, first.admittance), p=first.op.p, q=first.op.q)
    np.testing.assert_array_equal(arrays.points[0].admittance, first.admittance)
    with pytest.raises(ibrid.IbridError, match='unit="pu" or unit="S"'):
        ibrid.read_sweep(
            pd.DataFrame(
                {
                    "f": [1.0, 2.0],
                    "p": 1.0,
                    "q": 0.0,
                    **{f"Y{e}": [1j, 2j] for e in ("dd", "dq", "qd", "qq")},
                }
            )
        )
    with pytest.raises(ibrid.IbridError, match="found int"):
        ibrid.read_sweep(3)


@pytest.mark.slow
def test_values_show_themselves_in_a_line(record: ibrid.Record):
    """And so do the signatures of what a user calls."""
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    values = (
        sweep,
        sweep.points[0],
        record,
        ibrid.stability(record, scr=[2.0]),
        ibrid.predict(record, "p=0.5,q=0", [5.0, 50.0]),
    )
    assert [repr(value) for value in values if len(repr(value)) > 200 or "\n" in repr(value)] == []
    long = {
        name: len(str(inspect.signature(getattr(ibrid, name))))
        for name in ("evaluate", "find_gap", "predict", "search", "stability")
    }
    assert {
        name: length for name, length in long.items() if length > 1300
    } == {}  # annotations name their modules in full
    assert repr(sweep["p=1,q=0.3"]) == "<PointSweep: p=1,q=0.3, 16 frequencies, 5 to 5000 Hz>"


def test_export_tells_its_options_whether_its_package_is_loaded_or_not():
    package = importlib.import_module("ibrid.export")
    assert inspect.signature(package) == inspect.signature(package.export)
    assert "op: str | None = None" in str(inspect.signature(ibrid.export))


@pytest.mark.slow
def test_plots_go_on_axes_of_ones_own(record: ibrid.Record):
    figure = Figure()
    pair = figure.subplots(2)
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    assert sweep.plot(pair, "qq") is pair
    assert record.plot(pair, "qq") is pair
    assert len(pair[0].lines) == 6  # dots of two points, and dots and lines of two
    gap = made("named")
    elsewhere = ibrid.predict(record, "p=0.5,q=0", [5.0, 50.0])
    for shown in (gap, elsewhere):
        assert shown.plot(ax=pair) is pair
    one, study = figure.subplots(), ibrid.stability(record, scr=[2.0, 5.0])
    assert study.plot(one) is one
    for shown in (sweep, record, gap, elsewhere):
        with pytest.raises(ibrid.IbridError, match="two axes"):
            shown.plot(ax=one)
    with pytest.raises(ibrid.IbridError, match="ax must be one axes"):
        study.plot(ax=pair)
    assert matplotlib.get_backend()
