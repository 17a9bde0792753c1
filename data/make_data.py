"""Writes the shipped sweeps of our own reference inverters into this folder: python
data/make_data.py
"""

from pathlib import Path

from ibrid_bench.recipes import recipes

from ibrid.measurement.formats.csv_file import write_sweep


def main() -> None:
    """Same files every time: no noise, fixed seeds."""
    for benchmark in recipes():
        path = Path(__file__).parent / f"{benchmark.name}.csv"
        write_sweep(benchmark.sweep(), path, header=benchmark.header)
        print(path.name)


if __name__ == "__main__":
    main()
