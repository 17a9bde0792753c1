"""Steady states that no device has are refused with what was probably meant; unusual ones that are
real are read.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid import cli
from ibrid.errors import SweepError
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.recordings.event_samples import Samples, events_of
from ibrid.measurement.sweeps.sweep import Sweep

COLUMNS = [f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im")]
HZ = np.geomspace(1.0, 2000.0, 12)
SAID = {"f0_hz": 50.0, "current": "out", "q_axis": "leads"}


def scan(path: Path, head: str, cells: str, scale: float = 1.0) -> Path:
    """A resistance and inductance of 0.2 per unit, times `scale`, with cells in front of each
    row.
    """
    s = 1j * HZ[:, None, None] / 50
    y = -scale * np.linalg.inv(
        0.1 * (s * np.eye(2) + np.array([[0, -1], [1, 0]])) + 0.8 * np.eye(2)
    )
    rows = [
        ",".join([cells, *map(repr, [float(f), *m.ravel().view(float).tolist()])])
        for f, m in zip(HZ, y, strict=True)
    ]
    path.write_text("\n".join([",".join([head, "f [Hz]", *COLUMNS]), *rows]))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("head", "cells", "base", "words"),
    [
        (
            "P [kW],Q [kvar]",
            "225,0",
            "250,400",
            r"found 900 \(225 kVA on a base of 250 VA\), the base is probably 250 kVA",
        ),
        (
            "P [MW],Q [Mvar]",
            "80,20",
            "100kVA,220kV",
            r"found 824.6 .* the base is probably 100 MVA",
        ),
        (
            "P [MW],Q [Mvar]",
            "80,20",
            "100,220",
            r"found 8.246e\+05 .* the base is probably 100 MVA",
        ),
        (
            "P,Q,U [kV]",
            "0.5,0,20",
            "10MVA,20",
            r"found 1000 .* V and its base in kV: the base is probably 20 kV",
        ),
        (
            "P,Q,U [V]",
            "0.5,0,400",
            "10kVA,400kV",
            r"found 0.001 .* in kV and its base in V: the base is probably 400 V",
        ),
    ],
)
def test_a_base_that_cannot_be_is_refused_with_the_likely_one(
    tmp_path: Path, head: str, cells: str, base: str, words: str
):
    path = scan(tmp_path / "scan.csv", head, cells)
    with pytest.raises(SweepError, match=words):
        import_files([path], unit="pu", base=base, **SAID)
    assert (
        cli.main(
            [
                "import",
                str(path),
                "--unit",
                "pu",
                "--base",
                base,
                "--f0-hz",
                "50",
                "--out",
                f"{tmp_path}/o.csv",
            ]
        )
        == 2
    )


@pytest.mark.parametrize(
    ("base", "scale", "likely"),
    [
        ("250,400", 1.56, "250 kVA, 400 V"),
        ("250kVA,400kV", 1.56, "250 kVA, 400 V"),
        ("250kVA,0.4", 1.56, "250 kVA, 400 V"),
    ],
)
def test_a_base_is_refused_by_admittances_too(tmp_path: Path, base: str, scale: float, likely: str):
    """Of a device of 250 kVA at 400 V, whose base admittance is 1.56 S."""
    path = scan(tmp_path / "scan.csv", "p,q", "0.9,0", scale)
    with pytest.raises(SweepError, match=rf"per unit of a device.*the base is probably {likely}"):
        import_files([path], unit="S", base=base, **SAID)
    import_files([path], unit="S", base="250kVA,400V", **SAID).answered()


def test_a_base_a_thousand_times_too_large_is_refused_although_it_hides_the_power(tmp_path: Path):
    path = scan(tmp_path / "scan.csv", "P [kW],Q [kvar]", "225,0", 1.56)
    with pytest.raises(
        SweepError,
        match=r"must be above 0.02 per unit of a device.*the base is probably 250 kVA, 400 V",
    ):
        import_files([path], unit="S", base="250MVA,400V", **SAID)


def test_a_current_at_rest_of_hundreds_per_unit_is_refused(tmp_path: Path):
    """Y(0) of a device that holds p = 0.8 and q = 0.1 per unit of 250 kVA, on a base that is none
    of its own.
    """
    rest = -np.array([[0.8, -0.1], [-0.1, -0.8]]) * 1.56
    rows = [
        ",".join(map(repr, [float(f), *(rest + 0j).ravel().view(float).tolist()]))
        for f in (1.0, 2.0, 4.0, 8.0)
    ]
    path = tmp_path / "scan.csv"
    path.write_text("\n".join([",".join(["f [Hz]", *COLUMNS]), *rows]))
    said = {"unit": "S", "p": 0.8, "q": 0.1, "voltage_axis": "d", **SAID}
    with pytest.raises(
        SweepError,
        match="the current at rest, which the lowest frequencies show, must be at most 20 per unit",
    ):
        import_files([path], base="100MVA,220kV", **said)
    import_files([path], base="250kVA,400V", **said).answered()


@pytest.mark.parametrize(
    ("p", "q", "v"),
    [(0, 0, 1), (0.001, 0, 1), (3.0, 0.5, 1), (0.4, 0, 0.05), (-1.2, 0, 1.2), (1, 0, 1.732)],
)
def test_what_can_be_passes(tmp_path: Path, p: float, q: float, v: float):
    sweep = import_files(
        [scan(tmp_path / "scan.csv", "p,q,v", f"{p},{q},{v}")], unit="pu", **SAID
    ).answered()
    assert sweep.points[0].op.pqv == pytest.approx((p, q, v))


def test_commands_refuse_a_sweep_file_in_kilowatts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    points = tuple(replace(point, op=replace(point.op, p=900.0)) for point in sweep.points)
    path = tmp_path / "kilowatts.csv"
    ibrid.write_sweep(replace(sweep, points=points), path)
    for command in (["inspect"], ["evaluate", "gfl"], ["start"], ["gap", "gfl"]):
        assert (
            cli.main(
                [
                    *command,
                    str(path),
                    *(["--out", f"{tmp_path}/o"] if command[0] in ("gap", "start") else []),
                ]
            )
            == 2
        )
        assert "found 900, p and q are probably in kW or W" in capsys.readouterr().err


TIME = np.arange(0, 0.3, 1e-3)
REST, DIP = (1.0, 0.05)


def record(v: float, i: float, dip: float = 0.5, surge: float = 1.0) -> Samples:
    """A dip from 0.1 to 0.2 s; dq, in the unit of v and i."""
    away = (TIME > 0.1) & (TIME < 0.2)
    d = v * np.where(away, dip, 1.0)
    return Samples(
        "dip", TIME, np.stack([d, 0 * d]), np.stack([i * np.where(away, surge, 1.0), 0 * d])
    )


PEAK_V, PEAK_I = 400 * np.sqrt(2 / 3), 2 / 3 * 10e3 / (400 * np.sqrt(2 / 3))


@pytest.mark.parametrize(
    ("samples", "header", "words"),
    [
        (
            record(PEAK_V, PEAK_I),
            {"s_base_va": 10.0, "v_base_v": 400.0},
            r"found 1000 \(10 kVA on .*probably 10 kVA",
        ),
        (
            record(PEAK_V, PEAK_I),
            {"s_base_va": 10e3, "v_base_v": 0.4},
            r"found 1000 \(400 V on .*probably 400 V",
        ),
        (
            record(PEAK_V, 0.0, surge=1.0),
            {"s_base_va": 10e3, "v_base_v": 0.4},
            "V and its base in kV",
        ),
        (record(PEAK_V, 0.8 * PEAK_I), {"unit": "pu"}, "the columns are probably in V and A"),
    ],
)
def test_recordings_are_refused_alike(samples: Samples, header: dict[str, object], words: str):
    with pytest.raises(SweepError, match=words):
        events_of([samples], {"unit": "si", "frame": "dq", "f0_hz": 50.0, **header}, "dip.csv")


def test_an_idle_device_on_a_wrong_base_shows_in_its_event():
    idle = record(1.0, 1e-3, surge=2e6)
    with pytest.raises(
        SweepError, match="current must be at most 20 per unit in nearly all samples"
    ):
        events_of([idle], {"unit": "pu", "frame": "dq", "f0_hz": 50.0}, "dip.csv")


@pytest.mark.parametrize(
    ("i", "dip", "surge"), [(0.0, 0.05, 1.0), (0.8, 0.05, 3.75), (0.3, 0.5, 1.0), (-1.0, 1.3, 1.0)]
)
def test_faults_and_overcurrents_pass(i: float, dip: float, surge: float):
    events = events_of(
        [record(1.0, i, dip, surge)], {"unit": "pu", "frame": "dq", "f0_hz": 50.0}, "dip.csv"
    )
    assert events["dip"].rest.p == pytest.approx(i, abs=1e-9)


def test_every_shipped_sweep_passes():
    assert all(isinstance(ibrid.read_sweep(path), Sweep) for path in ibrid.benchmarks().values())
