"""`python -m ibrid_bench.real_sizes.growth`: how the processor seconds of a fit grow with the data
and the model.

The true structure at 50 dB, median of three seeds; the exponent is the slope of a straight line
through the logarithms. `--page` writes the table between its marks.
"""

import argparse
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ibrid_bench.markdown import markdown_table, write_between
from ibrid_bench.real_sizes.jobs import BAND, NOISE

import ibrid
from ibrid.fit import kernel
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.sweeping import plant_named
from ibrid.playback.recording import event_of, record_events

BEGIN, END = "<!-- made by ibrid_bench.real_sizes.growth -->", "<!-- end of growth -->"
SEEDS = 3
#: Per unit; the first so many.
POWERS = ((0.8, 0.1), (0.4, -0.2), (0.6, 0.0), (0.2, 0.2), (0.7, -0.1), (0.5, 0.1), (0.3, -0.1))


@dataclass(frozen=True)
class Size:
    """A fit; `plant` : of which the textbook diagram is fitted."""

    plant: str
    points: int
    frequencies: int

    def seconds(self) -> tuple[float, int]:
        """Processor seconds, and the states of the model."""
        points = [
            OperatingPoint(f"p={p:g},q={q:g}", p, q, 1.0)
            for p, q in (*POWERS, (0.9, 0.0))[: self.points]
        ]
        frequency = np.geomspace(*BAND, self.frequencies)
        clean = ibrid.sweep(plant_named(self.plant), points, frequency)
        sweep = ibrid.add_noise(clean, NOISE, rng=np.random.default_rng(0))
        diagram, found = ibrid.textbook(self.plant), []
        for seed in range(SEEDS):
            before = time.process_time()
            record = ibrid.evaluate(diagram, sweep, seed=seed)
            found.append(time.process_time() - before)
        return statistics.median(found), record.order


@dataclass(frozen=True)
class Recorded:
    """A fit to recordings of a dip and a jump of phase alone; `length` : of each, s."""

    length: float
    rate: float = 10_000.0

    def seconds(self) -> tuple[float, int]:
        """As of `Size`."""
        plant = plant_named("gfl_dc_link")
        point = OperatingPoint("own", *POWERS[0], 1.0)
        happened = [event_of("dip:0.7,at=0.05,for=0.1"), event_of("phase:15,at=0.05")]
        events = record_events(
            plant, [point], happened, rate=self.rate, length=self.length, noise_db=NOISE
        )
        diagram = ibrid.textbook("gfl_dc_link")
        before = time.process_time()
        record = ibrid.evaluate_events(diagram, events)
        return time.process_time() - before, record.order


FREQUENCIES = tuple(Size("gfm_droop", 2, count) for count in (16, 60, 250, 1000))
POINTS = tuple(Size("gfm_droop", count, 60) for count in (1, 2, 4, 8))
STATES = tuple(
    Size(name, 2, 60) for name in ("gfl_l_filter", "gfl_dc_link", "gfm_droop", "parallel_gfl_gfm")
)
#: Of each recording, s.
LENGTHS = (0.25, 0.5, 1.0, 2.0)
RECORDED = tuple(Recorded(length) for length in LENGTHS)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="write the table between its marks in this page")
    options = parser.parse_args()
    kernel.load()
    rows = [
        _row(
            "frequencies, 2 points, 15 states",
            FREQUENCIES,
            [one.frequencies for one in FREQUENCIES],
        ),
        _row("points of 60 frequencies, 15 states", POINTS, [one.points for one in POINTS]),
        _row("states, 2 x 60 frequencies", STATES, None),
        _row("seconds of two recordings at 10 kHz, 13 states", RECORDED, LENGTHS),
    ]
    table = markdown_table(("grows with", "sizes", "processor seconds", "exponent"), rows)
    print(table)
    if options.page:
        write_between(options.page, BEGIN, END, table)


def _row(
    name: str, sizes: Sequence[Size | Recorded], numbers: Sequence[float] | None
) -> tuple[str, ...]:
    found = [size.seconds() for size in sizes]
    seconds = [one for one, _ in found]
    numbers = [order for _, order in found] if numbers is None else numbers
    slope = np.polyfit(np.log(numbers), np.log(seconds), 1)[0]
    return (
        name,
        ", ".join(map(str, numbers)),
        ", ".join(f"{one:.2g}" for one in seconds),
        f"{slope:.1f}",
    )


if __name__ == "__main__":
    main()
