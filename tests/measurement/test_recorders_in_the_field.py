"""Recordings as recorders of the field write them: probes, two wattmeters, clocks, phasors of
phasor measurement units, times that only a sampling rate tells.
"""

from pathlib import Path

import numpy as np
from collecting import collecting
from recording_makes import (
    BASE,
    F0,
    I_PEAK,
    V_BASE,
    P,
    Q,
    current,
    six,
    text,
    times,
    voltage,
    written,
)

import ibrid
from ibrid import cli
from ibrid.measurement.recordings.events import EventRecord

BASES = {"base": "10MVA,20kV", "f0_hz": F0}
TURN = np.exp(-1j * np.deg2rad(13))
TIME, VALUES = six()
VA, VB, VC, IA, IB, IC = VALUES


def assert_is_the_law(record: EventRecord, digits: float = 1e-6) -> None:
    """p, q and v at rest, and every sample."""
    rest = np.subtract([record.rest.p, record.rest.q, record.rest.v], [P, Q, 1])
    assert np.abs(rest).max() < digits
    for name, law in (("v", voltage), ("i", current)):
        assert np.abs(getattr(record, name) @ [1, 1j] - law(record.time) * TURN).max() < digits


def imported(path: Path, *options: str) -> EventRecord:
    """The record that `ibrid import` makes of a file; its answer is that of success."""
    out = path.parent / "events.out.csv"
    assert cli.main(["import", str(path), *BASE, *options, "--out", str(out)]) == 0
    return ibrid.read_events(out).records[0]


def test_two_wattmeters_are_three_phases(tmp_path, capsys):
    """Voltages of phases 1 and 3 to phase 2, and the currents of both."""
    with collecting() as failures:
        for names, channels in (
            ("t (s)|U12 (V)|U32 (V)|I1 (A)|I3 (A)", ()),
            ("t (s)|A|B|C|D", ("--channels", "t=1,vab=2[V],vcb=3[V],ia=4[A],ic=5[A]")),
        ):
            with failures.case(names):
                columns = [TIME, VA - VB, VC - VB, IA, IC]
                (path,) = written(tmp_path, "two.csv", text(names.split("|"), columns))
                assert_is_the_law(imported(path, *channels))
                said = capsys.readouterr().err
                assert "for three wires: vbc [V], ib [A] from" in said
                assert "not used" not in said


def test_phasors_of_a_measurement_unit_are_those_of_the_positive_sequence(tmp_path):
    """VP_M, VP_A as phasor measurement units call them."""
    time = times(250)
    v, i = voltage(time), current(time)
    names = ["TIMESTAMP", "VP_M (V)", "VP_A (deg)", "IP_M (A)", "IP_A (deg)", "FREQ (Hz)"]
    sizes = [abs(v) * V_BASE / np.sqrt(3), abs(i) * I_PEAK / np.sqrt(2)]
    angles = [np.angle(one, deg=True) for one in (v, i)]
    columns = [sizes[0], angles[0], sizes[1], angles[1], np.full(len(time), F0)]
    stamps = np.datetime64("2026-03-01T11:59:59.9") + (time * 1e9).astype("timedelta64[ns]")
    rows = [
        ",".join([str(stamp).replace("T", " "), *(f"{cell:.12g}" for cell in row)])
        for stamp, row in zip(stamps, np.stack(columns, axis=1), strict=True)
    ]
    (path,) = written(tmp_path, "pmu.csv", "\n".join([",".join(names), *rows, ""]))
    options = ("--channels", "t=1,v_mag=2[V],v_ang=3[deg],i_mag=4[A],i_ang=5[deg],f=6")
    assert_is_the_law(imported(path))
    assert_is_the_law(imported(path, *options))
