"""Records of events as a sweep: the transforms obey the admittance of the device, whatever the
event does.
"""

import subprocess
import sys

import numpy as np
import pytest
from collecting import each_of
from scipy.signal import lfilter

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.transformed import transformed
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.sweeping import plant_named
from ibrid.playback.recording import event_of, record_events

R, L, OMEGA = 0.2, 0.4, 2 * np.pi * 60.0
OP = OperatingPoint("a", 0.0, 0.0, 1.0)


def branch(v: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Current out of a branch R, L at the terminals, voltage linear between the samples: L / omega
    di/dt = -v - R i - j L i.
    """
    pole, step = -OMEGA / L * (R + 1j * L), time[1] - time[0]
    move = np.exp(pole * step)
    weights = (
        np.array([move - 1 - pole * step, 1 + move * (pole * step - 1)])
        / (pole**2 * step)
        * -OMEGA
        / L
    )
    i = lfilter(weights, [1.0, -move], v @ [1, 1j])
    return np.stack([i.real, i.imag], axis=1)


def impedance(s: np.ndarray) -> np.ndarray:
    """(K, 2, 2) of that branch."""
    return (
        R * np.eye(2)
        + L / OMEGA * s[:, None, None] * np.eye(2)
        + L * np.array([[0.0, -1.0], [1.0, 0.0]])
    )


def test_the_transforms_of_a_branch_obey_its_impedance_though_the_record_ends_in_the_middle():
    time = np.arange(1200) / 10000
    rise = 0.5 * (1 - np.cos(np.pi * np.clip((time - 0.04) / 0.002, 0.0, 1.0)))
    v = rise[:, None] * [-0.2, 0.1] * np.where(time < 0.1, 1.0, 0.3)[:, None]
    record = EventRecord(OP, time, v + np.array([1.0, 0.0]), branch(v, time), 0.035)
    (point,) = transformed(Events((record,))).points
    expected = -np.linalg.solve(impedance(point.line), point.excitation)
    low = point.frequency < 500
    np.testing.assert_allclose(
        point.admittance[low], expected[low], atol=3e-3 * np.abs(expected[low]).max()
    )
    assert not point.admittance[:, :, 1].any()


@each_of("rate", [1000.0, 2000.0, 5000.0, 20000.0])
def test_their_noise_holds_what_nobody_measured_of_an_edge_of_any_length(rate):
    rng, fine = np.random.default_rng(0), 200_000
    time, apart = np.arange(fine // 4) / fine, int(fine / rate)
    for rise in (5e-5, 3e-4, 1e-3, 3e-3):
        left = []
        for at in 0.051 + rng.uniform(size=4) / rate:
            edges = (np.clip((time - one) / rise, 0.0, 1.0) for one in (at, at + 0.1))
            dip, back = (0.5 * (1 - np.cos(np.pi * one)) for one in edges)
            v = (dip - back)[:, None] * [-0.3, 0.1]
            some = slice(None, None, apart)
            record = EventRecord(
                OP, time[some], v[some] + np.array([1.0, 0.0]), branch(v, time)[some], at - 0.005
            )
            (point,) = transformed(Events((record,))).points
            error = point.admittance + np.linalg.solve(impedance(point.line), point.excitation)
            left.append(error[:, :, 0] / point.sigma[:, :, 0])
        assert np.sqrt(np.mean(np.abs(left) ** 2)) < 1.0, rise


@pytest.mark.slow
@each_of("name", ["gfl_l_filter", "paper_like", "gfl_dc_link", "gfm_droop", "gfm_vsm", "gfm_dvoc"])
def test_small_events_of_a_reference_inverter_obey_its_diagram(name):
    plant = plant_named(name)
    kinds = [event_of("step:0.001,at=0.05"), event_of("phase:0.05,at=0.05")]
    events = record_events(plant, plant.operating_points[:1], kinds, rate=5000.0, length=0.25)
    record = record_at(
        ibrid.parse_program(plant.program), ibrid.Study.of(events), plant.diagram_values
    )
    assert record.nrmse < 0.01


@pytest.mark.nightly
def test_a_fit_to_them_runs_on_the_loops_that_are_compiled_before_its_time_begins():
    program = """
import numpy as np, ibrid
from ibrid.fit import kernel
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.study import Study
kernel.load()
loops = (kernel.normal_equations, kernel.respond_with_derivatives, kernel.answer)
compiled = [set(one.signatures) for one in loops]
point = ibrid.read_sweep(ibrid.benchmarks()["gfl_l_filter"]).points[0]
excitation = np.broadcast_to(np.eye(2) + 0j, point.admittance.shape)
point = PointSweep(point.op, point.frequency, point.admittance, excitation=excitation, damping=10.0)
assert ibrid.evaluate(ibrid.textbook("gfl_l_filter"), Study(Sweep((point,))), restarts=0).outcome == "ok"
assert [set(one.signatures) for one in loops] == compiled
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr


def test_a_record_in_which_nothing_happens_says_nothing():
    time, steady = np.arange(600) / 5000, np.tile([1.0, 0.0], (600, 1))
    still = EventRecord(OperatingPoint("still", 0.8, 0.0, 1.0), time, steady, 0.8 * steady, 0.035)
    (point,) = transformed(Events((still,))).points
    assert not point.excitation.any()
    assert np.abs(point.admittance / point.sigma).max() < 1e-2
