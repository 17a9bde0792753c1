"""A simulated fleet, and how well `ibrid fleet` knows it: `python -m ibrid_bench.fleet draw DIR
--devices 1000`, then `ibrid fleet DIR/devices --out OUT`, then `python -m ibrid_bench.fleet score
DIR OUT`.

Devices are drawn from shipped programs, the first of `MAKES` the commonest (weights 1, 1/2, 1/3,
...), around values of their own make: its typical ones times a factor of 30 % spread for the make
and 20 % for each device. One in a hundred has a gain six times as large; one file in two hundred is
broken.
"""

import argparse
import csv
import json
from collections.abc import Mapping
from math import exp, log
from pathlib import Path

import numpy as np
from ibrid_bench.search.hidden import exact_model
from ibrid_search.fleet.running import Earlier

from ibrid.errors import IbridError
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.sweeping import frequency_grid
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.library import (
    published_names,
    published_values,
    textbook,
    textbook_text,
)
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

MAKES = (
    "gfl_delay",
    "gfl_l_filter",
    "gfl_power_filter",
    "gfl_dsogi_pll",
    "gfl_l_filter_delay",
    "gfm_direct_droop",
    "gfl_pll_filter_exact",
    "gfm_regfm_a1",
    "gfl_grid_current",
    "gfm_direct_vsm",
    "gfl_dc_link_q",
    "gfl_two_degrees",
)
MAKE_SPREAD, DEVICE_SPREAD, UNUSUAL = 0.3, 0.2, 6.0
POINT, FREQUENCY, DECIBEL = (
    OperatingPoint("p=0.8,q=0.2", 0.8, 0.2),
    frequency_grid("5:5000:12"),
    50.0,
)
BROKEN = (b"", b"no sweep\n", b"op,p,q,freq_hz\n1,2\n", b"\x89PNG\r\n\x1a\n" + bytes(64), b"{]")
#: Poles lie left of this (1/s).
MARGIN = -1.0


def draw(folder: Path, devices: int, seed: int) -> None:
    """Write the files of a fleet to `folder`/devices, and what is in them to `folder`/truth.csv."""
    (folder / "devices").mkdir(parents=True)
    usual = {
        name: _make(name, np.random.default_rng([seed, place])) for place, name in enumerate(MAKES)
    }
    weights = 1.0 / np.arange(1, len(MAKES) + 1)
    with (folder / "truth.csv").open("w", newline="") as stream:
        truth = csv.writer(stream)
        truth.writerow(("name", "make", "unusual", "values"))
        for number in range(devices):
            rng = np.random.default_rng([seed, 1000, number])
            name = f"device_{number:05d}.csv"
            file = folder / "devices" / name
            if number % 200 == 77:
                file.write_bytes(BROKEN[number // 200 % len(BROKEN)])
                truth.writerow((name, "broken", "", "{}"))
                continue
            make = str(rng.choice(MAKES, p=weights / weights.sum()))
            gain = (
                str(rng.choice(sorted(key for key in usual[make] if ".k" in key)))
                if number % 100 == 33
                else ""
            )
            sweep, values = _device(make, usual[make], gain, rng)
            write_sweep(sweep, file)
            truth.writerow((name, make, gain, json.dumps(values)))


def _make(name: str, rng: np.random.Generator) -> dict[str, float]:
    table = parameter_table(wire(textbook(name), VOCABULARY), "exact")
    typical = {one.name: one.typical for one in table.free}
    typical |= published_values(name) if name in published_names() else {}
    while True:
        values = _around(typical, MAKE_SPREAD, rng)
        if _swept(name, values) is not None:
            return values


def _device(
    make: str, usual: Mapping[str, float], gain: str, rng: np.random.Generator
) -> tuple[Sweep, dict[str, float]]:
    """A stable device; where a gain makes it unstable another is drawn, at last with a smaller
    one.
    """
    for attempt in range(200):
        values = _around(usual, DEVICE_SPREAD, rng)
        if gain:
            values[gain] *= UNUSUAL if attempt < 100 else 1.0 / UNUSUAL
        if (sweep := _swept(make, values)) is not None:
            return add_noise(sweep, DECIBEL, rng=rng), values
    raise IbridError(f"no stable device of {make} with another {gain} in 200 draws")


def _around(
    values: Mapping[str, float], spread: float, rng: np.random.Generator
) -> dict[str, float]:
    return {name: value * exp(spread * rng.standard_normal()) for name, value in values.items()}


def _swept(make: str, values: Mapping[str, float]) -> Sweep | None:
    """The clean sweep; None where the device is not stable on an ideal grid."""
    model = exact_model(textbook_text(make), values, [POINT], 50.0, "capacitor")
    if np.linalg.eigvals(model.state_space(POINT.name).A).real.max() > MARGIN:
        return None
    return Sweep((PointSweep(POINT, FREQUENCY, model.response(POINT.name, FREQUENCY)),), f0_hz=50.0)


def score(folder: Path, out: Path) -> None:
    """Print how many structures are right, how far values are off by the data alone and with the
    prior, and the outliers.
    """
    with (folder / "truth.csv").open(newline="") as stream:
        truth = {row["name"]: row for row in csv.DictReader(stream)}
    with (out / "devices.csv").open(newline="") as stream:
        answers = {row["name"]: row for row in csv.DictReader(stream)}
    prints = {make: structure_hash(textbook(make), VOCABULARY) for make in MAKES}
    right, alone, together, inside, covered = 0, [], [], [], []
    whole = [name for name, row in truth.items() if row["make"] != "broken"]
    with Earlier(out) as known:
        for name in whole:
            if answers[name]["status"] != "ok":
                continue
            record = known.record(name)
            if record.settings["fleet"]["structure"] != prints[truth[name]["make"]]:
                continue
            right += 1
            values = json.loads(truth[name]["values"])
            (found,) = record.parameters.values()
            (ends,) = record.intervals.values()
            for key, (value, low, high) in record.settings["prior"].get("joined", {}).items():
                if values[key] * value > 0 and values[key] * found[key] > 0:
                    alone.append(abs(log(found[key] / values[key])))
                    together.append(abs(log(value / values[key])))
                    covered.append(min(low, high) <= values[key] <= max(low, high))
                    if (own := ends.get(key)) is not None:
                        inside.append(own[0] <= values[key] <= own[1])
    planted = {name for name, row in truth.items() if row["unusual"]}
    told = {name for name, row in answers.items() if row["status"] == "ok" and row["words"]}
    print(f"{len(whole)} devices; structure right: {right} ({right / len(whole):.1%})")
    for label, errors in (("data alone", alone), ("with the prior", together)):
        quantiles = " ".join(f"{exp(one) - 1:.2%}" for one in np.percentile(errors, (50, 90, 99)))
        print(f"  values, {label}: 50, 90, 99 % of errors below {quantiles}")
    print(
        f"  95 % intervals hold the truth: {np.mean(inside):.1%} alone, {np.mean(covered):.1%} "
        "with the prior"
    )
    print(
        f"  outliers: {len(planted & told)} of {len(planted)} planted; {len(told - planted)} others"
    )
    broken = [name for name, row in truth.items() if row["make"] == "broken"]
    print(
        f"  broken files: {sum(answers[name]['status'] == 'failed' for name in broken)} of "
        f"{len(broken)} told"
    )


def main() -> None:
    """Draw a fleet, or score one."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True)
    drawing = commands.add_parser("draw")
    drawing.add_argument("folder", type=Path)
    drawing.add_argument("--devices", type=int, default=1000)
    drawing.add_argument("--seed", type=int, default=0)
    drawing.set_defaults(run=lambda one: draw(one.folder, one.devices, one.seed))
    scoring = commands.add_parser("score")
    scoring.add_argument("folder", type=Path)
    scoring.add_argument("out", type=Path)
    scoring.set_defaults(run=lambda one: score(one.folder, one.out))
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
