"""Writes the example files of the README into data/examples, as laboratories and recorders have
them: python data/make_examples.py
"""

from datetime import datetime
from pathlib import Path

import numpy as np
from openpyxl import Workbook

from ibrid.measurement.estimators.window import window_of
from ibrid.measurement.recordings.events import EventRecord
from ibrid.plants.sweeping import frequency_grid, plant_named, sweep
from ibrid.playback.recording import event_of, record_events

FOLDER = Path(__file__).parent / "examples"
#: The device: 50 kVA, 690 V, 60 Hz.
PLANT = plant_named("feng_50kva")
S_BASE, V_BASE, F0 = 50e3, 690.0, 60.0
#: Of the recordings: dB below the norm of the current.
NOISE_DB = 60.0
#: Frames per second of the PMU.
FRAMES = 60.0
_ENTRIES = (("dd", 0, 0), ("dq", 0, 1), ("qd", 1, 0), ("qq", 1, 1))
_PHASES = np.exp(-2j * np.pi / 3 * np.arange(3))


def main() -> None:
    """Same numbers every time: fixed seeds."""
    FOLDER.mkdir(exist_ok=True)
    write_scan(FOLDER / "scan.xlsx")
    write_fault(FOLDER / "fault.csv")
    write_pmu(FOLDER / "pmu.csv")


def write_scan(path: Path) -> None:
    """A workbook of admittances in S, of two operating points with p and q in kW and kvar."""
    measured = sweep(PLANT, None, frequency_grid("5:5000:40"), noise_db=50.0, seed=1)
    book = Workbook()
    book.properties.created = book.properties.modified = datetime(2026, 1, 1)
    sheet = book.worksheets[0]
    parts = [f"{part}(Y{entry}) [S]" for entry, _, _ in _ENTRIES for part in ("Re", "Im")]
    sheet.append(["P [kW]", "Q [kvar]", "f [Hz]", *parts])
    for point in measured.points:
        powers = [round(S_BASE / 1e3 * power, 2) for power in (point.op.p, point.op.q)]
        siemens = point.admittance * S_BASE / V_BASE**2
        for frequency, matrix in zip(point.frequency, siemens, strict=True):
            values = [matrix[row, column] for _, row, column in _ENTRIES]
            cells = [float(f"{part:.5g}") for one in values for part in (one.real, one.imag)]
            sheet.append([*powers, float(f"{frequency:.5g}"), *cells])
    book.save(path)


def write_fault(path: Path) -> None:
    """A dip as an EMT program or a recorder writes it: instantaneous phases in kV and kA."""
    record = recorded("dip:0.6,at=0.1,for=0.15", rate=4000.0, length=0.4)
    volts, amperes = V_BASE * np.sqrt(2 / 3) / 1e3, np.sqrt(2 / 3) * S_BASE / V_BASE / 1e3
    turning = np.exp(2j * np.pi * F0 * record.time)
    heads = ["Time [s]"]
    columns = [record.time]
    for letter, unit, value, size in (
        ("V", "kV", record.v, volts),
        ("I", "kA", record.i, amperes),
    ):
        phases = np.real(size * as_complex(value) * turning * _PHASES[:, None])
        heads += [f"{letter}{phase} [{unit}]" for phase in "abc"]
        columns += list(phases)
    write_table(path, heads, columns)


def write_pmu(path: Path) -> None:
    """Steps of the set point of power as a PMU of class P reports them."""
    record = recorded("p_ref:0.6,at=0.5", rate=2400.0, length=3.0)
    window = window_of(f"c37.118-P:{FRAMES:g}", F0)
    begin, end = window.span, record.time[-1] - window.span
    tags = np.arange(np.ceil(begin * FRAMES), np.floor(end * FRAMES)) / FRAMES
    seen = window.matrix(tags, record.time)
    v, i = (seen @ as_complex(value) for value in (record.v, record.i))
    told = np.where(tags < 0.5, PLANT.operating_points[0].p, 0.6)
    write_table(
        path,
        ["Time [s]", "V [V_LL]", "V_ang [deg]", "I [A rms]", "I_ang [deg]", "p_ref [pu]"],
        [
            tags,
            V_BASE * abs(v),
            np.angle(v, deg=True),
            S_BASE / np.sqrt(3) / V_BASE * abs(i),
            np.angle(i, deg=True),
            told,
        ],
    )


def recorded(event: str, *, rate: float, length: float) -> EventRecord:
    """What the device answers at its first operating point."""
    point = PLANT.operating_points[0]
    events = record_events(
        PLANT, [point], [event_of(event)], rate=rate, length=length, noise_db=NOISE_DB, seed=1
    )
    return events.records[0]


def as_complex(value: np.ndarray) -> np.ndarray:
    """(n,) d + j q of (n, 2)."""
    return value @ np.array([1.0, 1.0j])


def write_table(path: Path, heads: list[str], columns: list[np.ndarray]) -> None:
    """Rows of seven digits."""
    rows = [",".join(f"{cell:.7g}" for cell in row) for row in np.stack(columns, axis=1).tolist()]
    path.write_text("\n".join([",".join(heads), *rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
