"""`python -m ibrid_bench.events.motulator`: `ibrid gap` on recordings of control that nobody here
wrote.

motulator's grid-following converter is recorded through two dips and a step of the angle, and its
published diagram is the model, nominal values 15 % off. No effect is hidden in it: what the diagram
leaves of the dips is what continuous blocks leave of a sampled control.
"""

import argparse
import time
from math import pi

import numpy as np
from ibrid_bench.events.recorder import Recorder, recorded

from ibrid.gap.workflow import find_gap
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.motulator_bridge import Converter, MotulatorDevice
from ibrid.playback.recording import event_of
from ibrid.structure.diagrams.library import textbook

WORDS = ("dip:0.55", "phase:9.0", "dip:0.45")
AT, RISE, LASTS, LENGTH, RATE = 0.0612, 1.2e-3, 0.1, 0.3, 10_000.0
#: As motulator's source has them: bandwidths of current control and PLL (rad/s), sample (s),
#: inductance and resistance (pu).
BANDWIDTH, PLL, SAMPLE = 2 * pi * 400, 2 * pi * 20, 1e-4
INDUCTANCE, RESISTANCE, GAIN = 2 * pi * 50 * 10e-3 / 12.8, 0.1 / 12.8, -2 * pi * 400 * 10e-3 / 12.8
VALUES = {
    "plant.L_F": INDUCTANCE,
    "plant.R_F": RESISTANCE,
    "pll.kP_pll": 2 * PLL,
    "pll.kI_pll": PLL**2,
    "current.k": GAIN,
    "resistance.k": GAIN,
    "observer.omega_c": BANDWIDTH,
    "turned_in.L": 1 / BANDWIDTH,
    "e_filter.omega_c": 2 * PLL,
    "delay.T_d": 1.5 * SAMPLE,
    "integration.T_d": 0.5 * SAMPLE,
}
ASTRAY = 0.15


def main() -> int:
    """Record once, and ask at each noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise-db", type=float, action="append", help="repeatable (clean)")
    levels = parser.parse_args().noise_db or [None]
    device, point = MotulatorDevice(Converter()), OperatingPoint("rest", 0.6, 0.1, 1.0)
    waves = {}
    for word in WORDS:
        event = event_of(
            f"{word},at={AT},rise={RISE}" + ("" if word.startswith("phase") else f",for={LASTS}")
        )
        waves[word] = device.answer(
            point, lambda t, event=event: event.voltage(np.asarray(t), 1.0), LENGTH
        )
    for level in levels:
        rng = np.random.default_rng(1)
        values = {
            name: value * float(np.exp(ASTRAY * rng.standard_normal()))
            for name, value in VALUES.items()
        }
        events = recorded(
            Recorder(RATE, noise_db=level, bits=None if level is None else 16), waves, 50.0, rng
        )
        began = time.process_time()
        gap = find_gap(
            textbook("gfl_disturbance_observer"),
            None,
            values,
            events=events,
            holdout_op=events.names[-1],
            progress="silent",
        )
        print(
            f"{level} dB, {time.process_time() - began:.0f} s, {gap.verdict}: {gap.sentence}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
