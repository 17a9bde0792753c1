"""Writes the cases of the notebooks into data/examples: devices that programs apart from ibrid
simulate, and what hides in them. python data/make_cases.py
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np
from ibrid_bench.events.cases import TYPICAL
from ibrid_bench.events.device import Device as SimulatedDevice
from ibrid_bench.events.device import simulate
from ibrid_bench.hidden.__main__ import main as write_hidden_device
from ibrid_bench.hidden.device import Device, admittance
from ibrid_bench.playback.twins import limits_of, record_of, sweep_of, values_of
from ibrid_bench.recipes import recipes

import ibrid
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.sweeping import operating_point, state_space
from ibrid.playback.recording import event_of

FOLDER = Path(__file__).parent / "examples"
#: Of the devices in which something hides: the options of `python -m ibrid_bench.hidden`.
HIDDEN = {
    "hidden_loop": "--kind effect --seed 1 --noise-db 50 --points 4",
    "wrong_resistance": "--kind parameters --seed 3 --noise-db 60",
    "repetitive_control": "--kind foreign --seed 1 --noise-db 50",
}
#: Of the control that is simulated for events, with unit voltage feedforward.
CONTROL = {**TYPICAL, "feedforward": 1.0}
#: Decimals of recorded voltages and currents (pu).
DECIMALS = 7


def main() -> None:
    """Same numbers every time: fixed seeds."""
    for name in HIDDEN:
        write_hidden(name, FOLDER)
    write_bench_stand_in(FOLDER / "bench_stand_in.csv")
    write_unmeasured_point(FOLDER / "random_05_half_power.csv")
    write_twins(FOLDER / "twins")
    write_cessation(FOLDER / "cessation")


def write_hidden(name: str, folder: Path) -> None:
    """A sweep, its maker's model and nominal values in a folder; the truth in another."""
    with tempfile.TemporaryDirectory() as scratch:
        places = ["--out", str(folder / name), "--truth", scratch]
        if write_hidden_device([*HIDDEN[name].split(), *places]) != 0:
            raise SystemExit(f"{name} was not written")
        (folder / name / "holdout.csv").unlink(missing_ok=True)
        truths = folder / "truths"
        truths.mkdir(exist_ok=True)
        shutil.copyfile(Path(scratch) / "truth.json", truths / f"{name}.json")


def write_bench_stand_in(path: Path) -> None:
    """The published settings of Virginia Tech's bench, swept as it was: 3 % noise, p and q too
    large by sqrt 2 as its files first had them.
    """
    device = Device(
        filter="L",
        L_F=0.25,
        R_F=0.012,
        kP_pll=888.0,
        kI_pll=394_800.0,
        T_d=75e-6,
        kP_p=0.28,
        kI_p=200.0,
        kP_q=0.28,
        kI_q=200.0,
        kP_current=0.633,
        kI_current=1393.0,
        decoupling="pll",
        L_decoupling=0.1,
    )
    frequency = np.geomspace(40, 9990, 100)
    points = []
    for name, p, q in (("absorbing", 1.066, -0.477), ("delivering", 1.062, 0.552)):
        true_point = OperatingPoint(name, p / np.sqrt(2), q / np.sqrt(2))
        response = admittance(device, true_point, frequency, 2 * np.pi * 400, power_node="pcc")
        points.append(PointSweep(OperatingPoint(name, p, q), frequency, response))
    clean = Sweep(tuple(points), f0_hz=400.0, power_node="pcc", source="stand-in")
    noisy = ibrid.add_noise(clean, 30, rng=np.random.default_rng(0), record_sigma=False)
    write_sweep(noisy, path)


def write_unmeasured_point(path: Path) -> None:
    """The clean admittance of the inverter `random_05` at half power, where its sweep has none."""
    plant = next(recipe.plant for recipe in recipes() if recipe.name == "random_05")
    point = operating_point("p=0.5,q=0")
    frequency = np.geomspace(5, 5000, 60)
    response = state_space(plant, point).admittance(frequency)
    write_sweep(Sweep((PointSweep(point, frequency, response),), source="random_05"), path)


def write_twins(folder: Path) -> None:
    """A sweep with 0.1 % noise, a dip, and a swell that reaches the voltage limit."""
    folder.mkdir(exist_ok=True)
    numbers = {**CONTROL, "w_pll": 0.0}
    rng = np.random.default_rng(0)
    write_sweep(sweep_of(values_of(numbers), rng), folder / "sweep.csv")
    for name, event, limit in (
        ("dip", "dip:0.6,for=0.1", ""),
        ("swell", "swell:1.25,for=0.1", "command_limit"),
    ):
        device = SimulatedDevice(numbers, limits_of(numbers, limit, 1.04))
        record = record_of(device, event)
        change = np.sqrt(np.mean((record.i - record.i_rest) ** 2))
        write_record(
            folder / f"{name}.csv", record.rest, record, sigma=1e-3 * change, seed=len(name)
        )


def write_cessation(folder: Path) -> None:
    """Two faults of an inverter that ceases below 0.7 pu, holds 20 ms and returns at 8 pu/s, with
    0.3 % noise.
    """
    folder.mkdir(exist_ok=True)
    ceases = {"momentary_cessation": {"v_block": 0.7, "t_hold": 0.02, "ramp": 8.0}}
    device = SimulatedDevice({**CONTROL, "kP_pll": 40.0}, ceases)
    time = np.arange(1300) / 5000
    for seed, (name, event) in enumerate(
        (("fault", "dip:0.5,at=0.04,for=0.1"), ("next_fault", "dip:0.35,at=0.04,for=0.08"))
    ):
        voltage = event_of(event).voltage(time, 1.0)
        v = np.stack([voltage.real, voltage.imag], axis=1)
        i = simulate(device, (0.7, 0.1, 1.0), time, v)
        rest = OperatingPoint(name, float(i[0, 0]), float(-i[0, 1]), 1.0)
        record = EventRecord(rest, time, v, i, 0.0398)
        change = np.sqrt(np.mean((i - i[0]) ** 2))
        write_record(folder / f"{name}.csv", rest, record, sigma=3e-3 * change, seed=seed)


def write_record(
    path: Path, rest: OperatingPoint, record: EventRecord, *, sigma: float, seed: int
) -> None:
    """The record with white noise of the standard deviation sigma (pu) on its currents."""
    noise = sigma * np.random.default_rng(seed).standard_normal(record.i.shape)
    i = (record.i + noise).round(DECIMALS)
    level = np.full(len(i), float(f"{sigma:.4g}"))
    noisy = EventRecord(rest, record.time, record.v.round(DECIMALS), i, record.rest_end, level)
    write_events(Events((noisy,), power_node="pcc"), path)


if __name__ == "__main__":
    main()
