"""`python -m ibrid_bench.real_sizes`: processor seconds of the main jobs on inputs of the size that
people have: two to three operating points, 40 to 400 frequencies, clean and with noise, and
recordings.

Fits are medians of three seeds, the other jobs are run once. Two lines of profile say where the
time went. `--only TEXT` takes the jobs whose line has that in it, `--beside` adds other libraries
on the inputs of the fits.
"""

import argparse
import cProfile
import pstats
import statistics
import time
from collections.abc import Iterator

from ibrid_bench.real_sizes.beside import least_squares_row, vector_fit_row
from ibrid_bench.real_sizes.jobs import FITS, OTHERS, Fit, Job

from ibrid.fit import kernel

#: Seeds of a fit.
SEEDS = 3


def main() -> None:
    """Print a line for each job, and two of its profile."""
    parser = argparse.ArgumentParser(prog="ibrid_bench.real_sizes", description=__doc__)
    parser.add_argument("--only", default="", help="jobs whose line has this in it")
    parser.add_argument("--beside", action="store_true", help="scikit-rf and scipy beside the fits")
    options = parser.parse_args()
    kernel.load()
    for job in (*FITS, *OTHERS):
        if options.only not in str(job):
            continue
        print(_row(job, SEEDS if isinstance(job, Fit) else 1), flush=True)
        if options.beside and isinstance(job, Fit):
            print(f"{'':48s} {vector_fit_row(job)}", flush=True)
            print(f"{'':48s} {least_squares_row(job)}", flush=True)


def _row(job: Job, seeds: int) -> str:
    run = job.prepared()
    seconds, found, profile = [], [], cProfile.Profile()
    for seed in range(seeds):
        before = time.process_time()
        found.append(run(seed))
        seconds.append(time.process_time() - before)
    line = f"{job!s:48s} {statistics.median(seconds):6.2f} s   {'; '.join(dict.fromkeys(found))}"
    if seeds == 1:
        return line
    profile.runcall(run, 0)
    return "\n".join((line, *(f"    {one}" for one in _longest(profile))))


def _longest(profile: cProfile.Profile) -> Iterator[str]:
    """Yield a line for each of the two functions that took longest themselves."""
    rows = pstats.Stats(profile).get_stats_profile().func_profiles
    longest = sorted(rows.items(), key=lambda row: row[1].tottime, reverse=True)
    whole = sum(row.tottime for row in rows.values())
    for name, row in longest[:2]:
        yield f"{row.tottime / whole:4.0%} in {name}, {row.ncalls} calls"


if __name__ == "__main__":
    main()
