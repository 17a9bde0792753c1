"""Recordings as instruments and people write them: clocks of every kind, two of three currents or
line voltages, rms values between the phases.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from collecting import collecting

import ibrid

TIME = np.arange(0, 0.2, 5e-4)
ANGLES = 2 * np.pi * (50 * TIME[:, None] - np.arange(3) / 3)
VOLTS = 400 * np.sqrt(2 / 3) * np.cos(ANGLES)
AMPERES = 0.5 * 10e3 / 400 * np.sqrt(2 / 3) * np.cos(ANGLES)
LINES = VOLTS - np.roll(VOLTS, -1, axis=1)
HEAD = ["va [V]", "vb [V]", "vc [V]", "ia [A]", "ib [A]", "ic [A]"]
BODY = [*VOLTS.T, *AMPERES.T]
BASE = {"base": "10kVA,400V", "f0_hz": 50.0}


def written(folder: Path, head: list[str], columns: list, separator: str = ",") -> Path:
    rows = [
        separator.join(cell if isinstance(cell, str) else f"{cell:.9g}" for cell in row)
        for row in zip(*columns, strict=True)
    ]
    path = folder / "recording.csv"
    path.write_text("\n".join([separator.join(head), *rows]), encoding="utf-8")
    return path


def clock(seconds: float, mark: str = ".") -> str:
    minutes, rest = divmod(seconds, 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours % 24:02d}:{minutes:02d}:{rest:09.6f}".replace(".", mark)


def half_day(seconds: float) -> str:
    hour = int(seconds // 3600) % 24
    return f"3/1/2026 {(hour - 1) % 12 + 1}{clock(seconds)[2:]} {'PM' if hour >= 12 else 'AM'}"


#: Name -> names and cells of the columns of time.
CLOCKS: dict[str, tuple[list[str], list[Callable[[float], object]]]] = {
    "a clock without a date": (["Time"], [lambda t: clock(43200 + t)]),
    "a clock over midnight": (["Time"], [lambda t: clock(86399.9 + t)]),
    "date and time apart": (
        ["Date", "Time"],
        [lambda t: "01.03.2026", lambda t: clock(43200 + t)],
    ),
    "AM and PM over noon": (["Time"], [lambda t: half_day(43199.9 + t)]),
    "Unix ms": (["Timestamp"], [lambda t: f"{1772366400000 + 1e3 * t:.3f}"]),
    "Unix us": (["Timestamp"], [lambda t: f"{1772366400000000 + 1e6 * t:.0f}"]),
    "Unix ns": (["Timestamp"], [lambda t: f"{1772366400000000000 + round(1e9 * t)}"]),
    "Unix s": (["Timestamp"], [lambda t: f"{1772366400 + t:.6f}"]),
}


def test_clocks_of_every_kind_are_read(tmp_path):
    with collecting() as failures:
        for name, (head, cells) in CLOCKS.items():
            with failures.case(name):
                times = [[cell(t) for t in TIME.tolist()] for cell in cells]
                path = written(tmp_path, [*head, *HEAD], [*times, *BODY])
                record = ibrid.read_events(path, **BASE).records[0]
                assert len(record.time) == len(TIME)
                np.testing.assert_allclose(np.diff(record.time), 5e-4, atol=2e-6)
                assert record.rest.p == pytest.approx(0.5, abs=2e-3)


def test_two_of_three_currents_or_line_voltages_are_enough(tmp_path):
    three = dict(zip(HEAD, BODY, strict=True))
    lines = dict(zip(["Vab [V]", "Vbc [V]", "Vca [V]"], LINES.T, strict=True))
    backward = {
        f"V{two[1]}{two[0]} [V]": -value
        for two, value in zip(["ab", "bc"], LINES.T[:2], strict=True)
    }
    currents = {name: three[name] for name in HEAD[3:]}
    cases = {
        "ia and ib": {name: three[name] for name in HEAD[:5]},
        "ib and ic": {name: three[name] for name in (*HEAD[:3], *HEAD[4:])},
        "vab and vca": {"Vab [V]": lines["Vab [V]"], "Vca [V]": lines["Vca [V]"], **currents},
        "vbc and vca": {"Vbc [V]": lines["Vbc [V]"], "Vca [V]": lines["Vca [V]"], **currents},
        "vba and vcb": {**backward, **currents},
        "vab and vca beside powers": {
            "Vab [V]": lines["Vab [V]"],
            "Vca [V]": lines["Vca [V]"],
            **currents,
            "P [kW]": 0 * TIME + 5.0,
            "Q [kvar]": 0 * TIME,
        },
        "vab, vbc, ia, ib": {
            "Vab [V]": lines["Vab [V]"],
            "Vbc [V]": lines["Vbc [V]"],
            "ia [A]": currents["ia [A]"],
            "ib [A]": currents["ib [A]"],
        },
    }
    with collecting() as failures:
        for name, columns in cases.items():
            with failures.case(name):
                path = written(tmp_path, ["t", *columns], [TIME, *columns.values()])
                record = ibrid.read_events(path, **BASE).records[0]
                assert (record.rest.p, record.rest.q) == pytest.approx((0.5, 0.0), abs=2e-3)
                assert np.abs(record.v - [1.0, 0.0]).max() < 2e-3
                assert (
                    any("for three wires" in remark for remark in record.remarks) or "Vbc" in name
                )


def test_rms_values_between_the_phases_stand_beside_powers(tmp_path):
    slow = np.arange(0, 5, 0.02)
    step = np.where(slow < 2, 1.0, 0.8)
    head = ["t [s]", "U12 [V]", "U23 [V]", "U31 [V]", "P [kW]", "Q [kvar]"]
    columns = [slow, 400 * step, 402 * step, 398 * step, 0 * slow + 5.0, 0 * slow + 1.0]
    record = ibrid.read_events(written(tmp_path, head, columns), **BASE).records[0]
    assert (record.rest.p, record.rest.q, record.rest.v) == pytest.approx((0.5, 0.1, 1.0), abs=1e-3)
    assert np.abs(record.v[-1]) == pytest.approx([0.8, 0.0], abs=1e-3)
