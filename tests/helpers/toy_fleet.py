"""A fleet whose devices are quick to examine: one small fit each, and files whose names do things
to their worker.
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from ibrid_search.fleet.examining import DeviceJob, Examiner, read_device, told
from ibrid_search.fleet.running import Fleet, fleet

import ibrid
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.study import Study

PROGRAM = "gfl_l_filter"
POINT, FREQUENCY = OperatingPoint("p=0.8,q=0.2", 0.8, 0.2), np.geomspace(5.0, 5000.0, 12)
QUICK = FitSettings(
    starts=16, kept=2, kept_misfit=2, halving=((4, 2),), restarts=0, hops=0, ipopt_iterations=5
)


class ToyExaminer(Examiner):
    """One small fit, from the typical values of the fleet where it has any."""

    def assess(self, job: DeviceJob) -> Record:
        if "dies" in job.name:
            os._exit(1)
        while "hangs" in job.name or _held(job.name):
            time.sleep(0.02)
        study = Study(read_device(job), seed=self.seed)
        known = {POINT.name: job.prior.families[0].values} if job.prior.families else {}
        record = ibrid.evaluate(ibrid.textbook(PROGRAM), study, settings=QUICK, warm=known)
        return told(record, study, job.prior, bool(known))


def _held(name: str) -> bool:
    """Whether TOY_FLEET_HELD, "NUMBER FILE", holds back a device from that number on, as it does
    while the file is there.
    """
    number, _, file = os.environ.get("TOY_FLEET_HELD", "").partition(" ")
    return bool(file) and Path(file).exists() and name >= f"device_{int(number):02d}"


def typical(program: str = PROGRAM) -> dict[str, float]:
    """Typical values of a shipped program's parameters."""
    table = parameter_table(wire(ibrid.textbook(program), VOCABULARY), "exact")
    return {one.name: one.typical for one in table.free}


def device(values: dict[str, float], seed: int, program: str = PROGRAM) -> Sweep:
    """The sweep of a device of that program, noise 50 dB below it."""
    clean = Sweep(
        (PointSweep(POINT, FREQUENCY, np.ones((len(FREQUENCY), 2, 2), dtype=complex)),), f0_hz=50.0
    )
    record = record_at(ibrid.textbook(program), clean, values)
    point = replace(clean.points[0], admittance=record.response(POINT.name, FREQUENCY))
    return ibrid.add_noise(replace(clean, points=(point,)), 50.0, rng=np.random.default_rng(seed))


def write_fleet(folder: Path, devices: int) -> Path:
    """Files of devices whose values are spread by 10 %."""
    folder.mkdir()
    for number in range(devices):
        rng = np.random.default_rng([7, number])
        values = {
            name: value * np.exp(0.1 * rng.standard_normal()) for name, value in typical().items()
        }
        write_sweep(device(values, number), folder / f"device_{number:02d}.csv")
    return folder


def examined(folder: Path, out: Path, **options) -> Fleet:
    """The fleet in a folder, by toy examiners."""
    return fleet(folder, out, job=ToyExaminer(), **options)


def main() -> None:
    """FOLDER OUT, and --resume."""
    examined(Path(sys.argv[1]), Path(sys.argv[2]), workers=2, resume=len(sys.argv) > 3)
