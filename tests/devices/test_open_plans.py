"""What `ibrid open` measures: which frequencies, what is held out, and all measurements as one."""

from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from fitted import benchmark, evaluated, measured
from ibrid_search.opening import planning
from ibrid_search.opening.device_data import INTEGRATED, join_measurements
from ibrid_search.opening.planning import coarse_sweeps, frequencies_for, held_out_experiments
from ibrid_search.opening.story import DeviceExperiment
from ibrid_search.opening.structures import Structures, refit_structures
from scipy.interpolate import CubicSpline

import ibrid
from ibrid.analysis.new_data.experiments import Experiment
from ibrid.devices import DeviceFile
from ibrid.devices.device_file import device_of
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants import operating_point


def device(folder: Path, step_s: float = 1e-4, signals: dict | None = None) -> DeviceFile:
    told = {"kind": "python", "file": "model.py:Inverter", "step_s": step_s}
    taken = {"p_ref": {"name": "p_ref"}, "q_ref": {"name": "q_ref"}}
    return device_of(
        {**told, "signals": taken if signals is None else signals}, folder, "the device"
    )


def test_a_sweep_has_ten_samples_in_its_shortest_period(tmp_path: Path):
    assert max(frequencies_for(device(tmp_path, 1e-3))) == pytest.approx(100.0)
    assert max(frequencies_for(device(tmp_path, 1e-6))) == pytest.approx(2000.0)


def test_what_is_held_out_was_not_measured(tmp_path: Path):
    made = device(tmp_path)
    done = [
        DeviceExperiment("sweep", op, "", file=f"{op}.csv") for op in ("p=0.8,q=0", "p=0.2,q=0")
    ]
    done.append(DeviceExperiment("event", "p=0.8,q=0", "", "dip:0.3", file="dip.csv"))
    sweep, event, step = held_out_experiments(made, done)
    assert sweep.op not in [experiment.op for experiment in done]
    assert not {*sweep.frequencies} & {*frequencies_for(made)}
    assert event.event.partition(":")[0] == "phase"
    p = operating_point(step.op).p
    assert float(step.event.partition(":")[2]) == pytest.approx(p + 0.1, abs=1e-3)


def test_a_device_without_references_is_held_out_where_it_rests(tmp_path: Path):
    made = device(tmp_path, signals={})
    done = [
        DeviceExperiment("sweep", "p=0.5,q=0", "", frequencies=frequencies_for(made), file="a.csv")
    ]
    sweep, _, step = held_out_experiments(made, done)
    assert sweep.op == "p=0.5,q=0"
    assert step.event.startswith("step:")


def test_the_coarse_sweep_says_why_each_set_point_is_measured(tmp_path: Path):
    first, second = coarse_sweeps(device(tmp_path), ("p=0.8,q=0", "p=0.2,q=0"))
    assert first.why != second.why
    assert first.frequencies == second.frequencies


def test_sweeps_are_joined_with_the_deviation_that_sampling_leaves(tmp_path: Path):
    """|sigma| of real and imaginary parts is its part of |Y| over the root of two; a cubic spline
    through ten samples of a period has its gain wrong by 2e-4.
    """
    sweep = measured(["p=0.8,q=0.2"], frequency=np.array([20.0, 1000.0]))
    write_sweep(sweep, tmp_path / "a.csv")
    done = [DeviceExperiment("sweep", "p=0.8,q=0.2", "", file="a.csv")] * 2
    done.append(DeviceExperiment("sweep", "p=9,q=9", "", refused="does not rest there"))
    joined, events = join_measurements(done, tmp_path, 1e-4)
    assert events is None
    assert joined.names == ("p=0.8,q=0.2", "p=0.8,q=0.2 again 1")
    time = np.arange(200)
    spline = CubicSpline(time, np.cos(0.2 * np.pi * time))
    middle = np.linspace(90.0, 110.0, 2001)[:-1]
    gain = 2 * np.mean(spline(middle) * np.cos(0.2 * np.pi * middle))
    left = [INTEGRATED, np.hypot(INTEGRATED, gain - 1)]
    for point in joined.points:
        size = np.linalg.norm(point.admittance, axis=(1, 2))
        deviation = np.linalg.norm(point.sigma, axis=(1, 2))
        np.testing.assert_allclose(np.sqrt(2) * deviation / size, left, rtol=0.15)


def ranking(*told: tuple[float, float]) -> tuple[Experiment, ...]:
    """Sweeps with bits between two structures (none where negative) and on each parameter."""
    return tuple(
        Experiment(
            OperatingPoint("asked", 0.1 * number, 0.0, 1.0),
            (20.0, 90.0),
            {"pll.kP": 0.5},
            information,
            () if bits < 0 else (("a" * 32, "b" * 32, bits),),
        )
        for number, (bits, information) in enumerate(told)
    )


ENDINGS = [
    ([(30.0, 0.1), (2.0, 9.0)], ""),
    ([(0.8, 9.0), (0.3, 20.0)], "promises 0.8 bits between the structures that are open, less"),
    ([(0.01, 9.0)], "tells the structures that are open from one another"),
    ([(-1.0, 3.0)], ""),
    ([(-1.0, 0.2)], "promises 0.2 bits on each parameter, less than 1"),
]


@each_of(("told", "ending"), ENDINGS)
def test_the_best_experiment_is_made_where_it_promises_enough(
    told: list, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(planning, "experiments", lambda *_: ranking(*told))
    monkeypatch.setattr(planning, "with_twins", lambda *both: both)
    known = Structures(("a" * 32,), ())
    plan = planning.choose_experiment(device(tmp_path), known, [], ("p=0.8,q=0",), 1.0)
    assert (plan.experiment is None) == bool(ending)
    assert ending in plan.ending
    if plan.experiment is not None:
        assert plan.experiment.op == "p=0,q=0"
        assert ("aaaaaaaa and bbbbbbbb" if told[0][0] > 0 else "pll.kP") in plan.experiment.why


def test_an_experiment_that_was_made_is_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(planning, "experiments", lambda *_: ranking((9.0, 1.0), (8.0, 1.0)))
    monkeypatch.setattr(planning, "with_twins", lambda *both: both)
    known = Structures(("a" * 32, "b" * 32), ())
    done = [DeviceExperiment("sweep", "p=0,q=0", "")]
    plan = planning.choose_experiment(device(tmp_path), known, done, ("p=0.8,q=0",), 1.0)
    assert plan.experiment is not None
    assert plan.experiment.op == "p=0.1,q=0"
    done.append(plan.experiment)
    plan = planning.choose_experiment(device(tmp_path), known, done, ("p=0.8,q=0",), 1.0)
    assert plan.ending == "every experiment among those that are ranked was made"


@pytest.mark.slow
def test_a_structure_that_new_data_exclude_is_ruled_out():
    """A grid-following inverter with a filtered PLL, and the diagram without that filter."""
    sweep = ibrid.add_noise(benchmark(), 60.0, rng=np.random.default_rng(0))
    names = ("a" * 32, "b" * 32)
    records = tuple(evaluated(name, restarts=0) for name in ("gfl_exact", "gfl_pll_filter_exact"))
    fitted: list[str] = []
    left = refit_structures(Structures(names, records), sweep, None, fitted.append)
    assert fitted == ["aaaaaaaa", "bbbbbbbb"]
    assert left.names == ("b" * 32,)
    assert left.ruled_out == ("aaaaaaaa: odds of more than 1e+06 to 1 against it",)
    assert left.answer.grade == "explains"
