"""Multisines against single tones: error and simulated seconds of the same sweep of reference
inverters sampled at 10 kHz.

    python -m ibrid_bench.single_tones

The truth is the linearisation at the operating point that the inverter delivers at its terminals.
"""

import time
from pathlib import Path

import numpy as np
from scipy.optimize import fsolve

from ibrid.devices.device_file import DeviceFile, device_of
from ibrid.devices.experiment import measure_response
from ibrid.devices.fresh_device import USUAL, FreshDevice
from ibrid.devices.multisine import Multisine, multisine_for
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.sweeping import frequency_grid, operating_point, plant_named, state_space
from ibrid.writing import aligned

PLANTS = ("paper_like", "gfl_l_filter", "gfm_droop")
POINTS = ("p=0.8,q=0.2", "p=0.3,q=-0.1")
FREQUENCY, STEP_S = "5:2000:40", 1e-4


def main() -> None:
    """Print a table."""
    rows: list[tuple[str, ...]] = [
        ("inverter", "injected", "median error", "largest error", "simulated s", "processor s")
    ]
    for name in PLANTS:
        file = device_of({"kind": "reference", "file": name, "step_s": STEP_S}, Path(), name)
        together = multisine_for(frequency_grid(FREQUENCY), STEP_S, file.f0_hz)
        tones = [multisine_for([hz], STEP_S, file.f0_hz) for hz in together.frequency]
        for words, injected in (("multisine", [together]), ("single tones", tones)):
            rows.append((name, words, *_measured(file, injected)))
    print(aligned(rows))


def _measured(file: DeviceFile, injected: list[Multisine]) -> tuple[str, ...]:
    began = time.process_time()
    errors, simulated = list[float](), 0.0
    for text in POINTS:
        op = operating_point(text)
        with FreshDevice.here(file, USUAL).bench() as bench:
            rest, _ = bench.reach(op, file.references)
            for multisine in injected:
                response = measure_response(
                    bench, op.v, multisine, peak=USUAL.peak, repeats=3, most_periods=12
                )
                truth = _truth(file.file, rest, multisine.frequency)
                difference = np.linalg.norm(response.admittance - truth, axis=(1, 2))
                errors += (difference / np.linalg.norm(truth, axis=(1, 2))).tolist()
            simulated += bench.simulated_s
    took = time.process_time() - began
    return f"{np.median(errors):.1e}", f"{max(errors):.1e}", f"{simulated:.0f}", f"{took:.1f}"


def _truth(name: str, rest: OperatingPoint, frequency: np.ndarray) -> np.ndarray:
    plant = plant_named(name)

    def missing(power: np.ndarray) -> list[float]:
        p, q = power.tolist()
        own = plant.at_rest(OperatingPoint("own", p, q, rest.v))
        d, q = np.array(plant.dynamics.g(own.x, [rest.v, 0.0])).ravel().tolist()
        return [rest.v * d - rest.p, -rest.v * q - rest.q]

    p, q = np.asarray(fsolve(missing, [rest.p, rest.q], xtol=1e-13)).tolist()
    return state_space(plant, OperatingPoint("own", p, q, rest.v)).admittance(frequency)


if __name__ == "__main__":
    main()
