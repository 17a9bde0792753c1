"""What `ibrid open` measures: which frequencies, what is held out, and all measurements as one."""

from pathlib import Path

import numpy as np
import pytest
from fitted import measured
from ibrid_search.opening.device_data import SAMPLED, data_of
from ibrid_search.opening.planning import coarse, frequencies_for, held_out
from ibrid_search.opening.story import DeviceExperiment

from ibrid.devices import DeviceFile
from ibrid.devices.device_file import device_of
from ibrid.measurement.formats.csv_file import write_sweep
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
    sweep, event, step = held_out(made, done)
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
    sweep, _, step = held_out(made, done)
    assert sweep.op == "p=0.5,q=0"
    assert step.event.startswith("step:")


def test_the_coarse_sweep_says_why_each_set_point_is_measured(tmp_path: Path):
    first, second = coarse(device(tmp_path), ("p=0.8,q=0", "p=0.2,q=0"))
    assert first.why != second.why
    assert first.frequencies == second.frequencies


def test_sweeps_are_joined_with_the_deviation_that_sampling_leaves(tmp_path: Path):
    """Of real and imaginary parts alike: |sigma| is its part of |Y| over the root of two."""
    sweep = measured(["p=0.8,q=0.2"], frequency=np.array([20.0, 90.0]))
    write_sweep(sweep, tmp_path / "a.csv")
    done = [DeviceExperiment("sweep", "p=0.8,q=0.2", "", file="a.csv")] * 2
    done.append(DeviceExperiment("sweep", "p=9,q=9", "", refused="does not rest there"))
    joined, events = data_of(done, tmp_path)
    assert events is None
    assert joined.names == ("p=0.8,q=0.2", "p=0.8,q=0.2 again 1")
    for point in joined.points:
        size = np.linalg.norm(point.admittance, axis=(1, 2))
        deviation = np.linalg.norm(point.sigma, axis=(1, 2))
        np.testing.assert_allclose(np.sqrt(2) * deviation / size, SAMPLED)
