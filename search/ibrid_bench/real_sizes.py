"""`python -m ibrid_bench.real_sizes`: processor seconds of a fit on inputs of the size that people
have, from two to three operating points, 40 to 400 frequencies, clean and with noise.

Each row is the true structure, fitted as `ibrid evaluate` does, the median of three seeds. Two
lines of profile say where the time went. `--only NAME` takes the rows whose text has that in it.
"""

import argparse
import cProfile
import pstats
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import ibrid
from ibrid.evaluation.record import Record
from ibrid.fit import kernel
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.plants.sweeping import plant_named

SEEDS = 3
POINTS = tuple(
    OperatingPoint(f"p={p:g},q={q:g}", p, q, 1.0) for p, q in ((0.8, 0.1), (0.4, -0.2), (0.6, 0.0))
)
#: Hz.
BAND = (2.0, 4000.0)


@dataclass(frozen=True)
class Input:
    """A reference inverter that is measured, the textbook diagram of its structure, and the size.

    noise_db : of the noise that is added; None for clean data.
    """

    plant: str
    diagram: str
    points: int
    frequencies: int
    noise_db: float | None = None

    def __str__(self) -> str:
        noise = "clean" if self.noise_db is None else f"{self.noise_db:g} dB"
        return f"{self.diagram} {self.points} x {self.frequencies}, {noise}"

    def sweep(self) -> Sweep:
        """The admittance, with its noise."""
        frequency = np.geomspace(*BAND, self.frequencies)
        clean = ibrid.sweep(plant_named(self.plant), POINTS[: self.points], frequency)
        if self.noise_db is None:
            return clean
        return ibrid.add_noise(clean, self.noise_db, rng=np.random.default_rng(0))


INPUTS = (
    Input("gfl_l_filter", "gfl_l_filter", 2, 60),
    Input("gfl_l_filter", "gfl_l_filter", 2, 240, 50.0),
    Input("paper_like", "gfl_pll_filter_exact", 3, 60, 50.0),
    Input("paper_like", "gfl_pll_filter_exact", 2, 384, 40.0),
    Input("gfl_dc_link", "gfl_dc_link", 2, 48, 50.0),
    Input("gfm_droop", "gfm_droop", 2, 16),
    Input("gfm_droop", "gfm_droop", 2, 60),
    Input("gfm_droop", "gfm_droop", 3, 60),
    Input("gfm_droop", "gfm_droop", 2, 240),
    Input("gfm_droop", "gfm_droop", 3, 60, 50.0),
    Input("gfm_vsm", "gfm_vsm", 3, 60),
    Input("gfm_vsm", "gfm_vsm", 2, 48, 50.0),
    Input("gfm_dvoc", "gfm_dvoc", 3, 60, 50.0),
    Input("hybrid_gfl_gfm", "hybrid_gfl_gfm", 3, 60, 50.0),
)


def main() -> None:
    """Print a line for each input, and two of its profile."""
    parser = argparse.ArgumentParser(prog="ibrid_bench.real_sizes", description=__doc__)
    parser.add_argument("--only", default="", help="rows whose text has this in it")
    only = parser.parse_args().only
    kernel.load()
    for one in INPUTS:
        if only not in str(one):
            continue
        sweep = one.sweep()
        records, seconds, profile = [], [], cProfile.Profile()
        for seed in range(SEEDS):
            before = time.process_time()
            records.append(ibrid.evaluate(ibrid.textbook(one.diagram), sweep, seed=seed))
            seconds.append(time.process_time() - before)
        profile.runcall(ibrid.evaluate, ibrid.textbook(one.diagram), sweep)
        print(f"{one!s:40s} {statistics.median(seconds):6.2f} s   NRMSE {_errors(records)}")
        for line in _longest(profile):
            print(f"    {line}", flush=True)


def _errors(records: list[Record]) -> str:
    return ", ".join("none" if one.nrmse is None else f"{one.nrmse:.2e}" for one in records)


def _longest(profile: cProfile.Profile) -> Iterator[str]:
    """Yield a line for each of the two functions that took longest themselves."""
    rows = pstats.Stats(profile).get_stats_profile().func_profiles
    longest = sorted(rows.items(), key=lambda row: row[1].tottime, reverse=True)
    whole = sum(row.tottime for row in rows.values())
    for name, row in longest[:2]:
        yield f"{row.tottime / whole:4.0%} in {name}, {row.ncalls} calls"


if __name__ == "__main__":
    main()
