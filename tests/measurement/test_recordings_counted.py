"""Recordings whose columns are counted in several ways: set points, units that are said twice,
columns that are not read.
"""

from pathlib import Path

import numpy as np
import pytest
from recording_makes import (
    F0,
    I_PEAK,
    S_BASE,
    V_BASE,
    V_PEAK,
    current,
    phases,
    text,
    times,
    voltage,
)

import ibrid
from ibrid.errors import IbridError
from ibrid.measurement.recordings.events import Events

BASES = {"base": "10MVA,20kV", "f0_hz": F0}
TIME = times(1000.0)
V, I = voltage(TIME), current(TIME)
POWER = V * np.conj(I)
PHASE_RMS, LINE_AMPERES = V_BASE / np.sqrt(3), S_BASE / (np.sqrt(3) * V_BASE)
Columns = dict[str, np.ndarray]


def read(folder: Path, columns: Columns, above: tuple[str, ...] = (), **said) -> Events:
    path = folder / "rec.csv"
    path.write_text(text(list(columns), list(columns.values()), above=above), encoding="utf-8")
    of_phases = any(name.startswith(("va", "vd")) for name in columns)
    window = {} if of_phases else {"window": "none"}
    return ibrid.read_events(path, **{**BASES, **window, **said})


def abc() -> Columns:
    """Phases in V and A."""
    v, i = V_PEAK * phases(V, TIME), I_PEAK * phases(I, TIME)
    named = {f"v{phase} [V]": row for phase, row in zip("abc", v, strict=True)}
    return {"t": TIME} | named | {f"i{p} [A]": row for p, row in zip("abc", i, strict=True)}


def lines() -> Columns:
    """Voltages between the phases in kV, currents in A."""
    v, i = V_PEAK / 1e3 * phases(V, TIME), I_PEAK * phases(I, TIME)
    between = {"vab [kV]": v[0] - v[1], "vbc [kV]": v[1] - v[2]}
    return {"t": TIME} | between | {f"i{p} [A]": row for p, row in zip("abc", i, strict=True)}


def dq() -> Columns:
    """d and q in V and A."""
    v, i = V_PEAK * V, I_PEAK * I
    named = {"vd [V]": v.real, "vq [V]": v.imag, "id [A]": i.real, "iq [A]": i.imag}
    return {"t": TIME} | named


def phasors(volts: float = PHASE_RMS, *, name: str = "v_mag [kV]") -> Columns:
    """Phasors of the positive sequence, of which 1 per unit has so many V."""
    return {
        "t": TIME,
        name: volts / 1e3 * abs(V),
        "v_ang [deg]": np.rad2deg(np.angle(V)),
        "i_mag [A]": LINE_AMPERES * abs(I),
        "i_ang [deg]": np.rad2deg(np.angle(I)),
    }


def powers(name: str = "v [kV]", size: float = V_BASE / 1e3) -> Columns:
    """Voltage, active and reactive power."""
    return {
        "t": TIME,
        name: size * abs(V),
        "p [MW]": S_BASE / 1e6 * POWER.real,
        "q [Mvar]": S_BASE / 1e6 * POWER.imag,
    }


def per_unit() -> Columns:
    """Voltage and powers per unit."""
    return {"t": TIME, "v [pu]": abs(V), "p [pu]": POWER.real, "q [pu]": POWER.imag}


FAMILIES = {
    "abc": abc,
    "lines": lines,
    "dq": dq,
    "phasors": phasors,
    "powers": powers,
    "per unit": per_unit,
}
#: How 1 per unit of a voltage set point is written.
VOLTAGES = {
    "v_ref [kV]": 20.0,
    "V_ref [V]": V_BASE,
    "v_ref [kV] of a phase, rms": PHASE_RMS / 1e3,
    "v_ref [kV] of a phase, peak": V_PEAK / 1e3,
    "v_ref [kV_LL]": 20.0,
    "v_ref [kV_LN]": PHASE_RMS / 1e3,
    "v_ref [kV_peak]": V_PEAK / 1e3,
    "v_ref [pu]": 1.0,
}


def last(values: np.ndarray) -> float:
    return float(values[-1])


@pytest.mark.parametrize("family", FAMILIES)
def test_a_voltage_set_point_is_per_unit_of_what_it_is_counted_in(tmp_path, family: str):
    wrong = []
    for name, one in VOLTAGES.items():
        column = name.split(" of")[0]
        told = np.where(TIME > 0.2, 1.05, 1.0) * one
        record = read(tmp_path, FAMILIES[family]() | {column: told}).records[0]
        found = record.told["v_ref"]
        if not np.allclose([found[0], found[-1]], [1.0, 1.05]) or abs(record.rest.v - 1) > 1e-4:
            wrong.append((name, found[0], found[-1]))
    assert wrong == []


@pytest.mark.parametrize("family", FAMILIES)
def test_powers_and_frequency_set_points_are_of_the_base(tmp_path, family: str):
    columns = {"p_ref [MW]": 8.0, "q_ref [pu]": 0.1, "f_ref [pu]": 1.0}
    table = FAMILIES[family]() | {name: np.full_like(TIME, one) for name, one in columns.items()}
    told = read(tmp_path, table).records[0].told
    assert {name: last(value) for name, value in told.items()} == pytest.approx(
        {"p_ref": 0.8, "q_ref": 0.1, "f_ref": F0}
    )


def test_a_voltage_set_point_of_no_known_size_is_asked_for(tmp_path):
    wrong = []
    for size in (13.8, 17.8):
        column = {"v_ref [kV]": np.full_like(TIME, size)}
        with pytest.raises(IbridError, match=r"name its column v_ref \[k?V_LL\]"):
            read(tmp_path, abc() | column)
        told = read(tmp_path, abc() | {"v_ref [kV_LL]": np.full_like(TIME, size)})
        if abs(last(told.records[0].told["v_ref"]) - size / 20) > 1e-9:
            wrong.append(size)
    assert wrong == []


def test_set_points_are_listed_among_the_readings(tmp_path):
    told = {"v_ref [kV]": np.full_like(TIME, 20.0), "p_ref [pu]": np.full_like(TIME, 0.8)}
    notes = read(tmp_path, abc() | told).notes
    assert "read as - v_ref; v_ref [kV]; V times 1000, line to line, rms" in notes
    assert "read as - p_ref; p_ref [pu]; per unit" in notes


def test_columns_that_are_not_read_are_said(tmp_path):
    more = {f"theta_{number}": np.full_like(TIME, number) for number in range(9)}
    said = {
        name: read(tmp_path, table).records[0].remarks
        for name, table in {"more": abc() | more, "none": abc()}.items()
    }
    listed = ", ".join(list(more)[:8])
    assert f"not used: {listed} and 1 more" in said["more"]
    assert [one for one in said["none"] if "not used" in one] == []


def test_a_set_point_with_gaps_is_said_not_to_be_used(tmp_path):
    told = np.where(TIME > 0.2, np.nan, 0.8)
    record = read(tmp_path, abc() | {"p_ref [pu]": told}).records[0]
    assert "not used: p_ref [pu]" in record.remarks
    assert dict(record.told) == {}


def test_a_minus_before_a_set_point_is_its_sign(tmp_path):
    wrong = []
    for name in ("-p_ref [pu]", "- p_ref [pu]", "−p_ref [pu]"):
        record = read(tmp_path, abc() | {name: np.full_like(TIME, -0.8)}).records[0]
        if last(record.told.get("p_ref", np.zeros(1))) != pytest.approx(0.8):
            wrong.append((name, record.told))
        if not any("read with the other sign" in one for one in record.remarks):
            wrong.append((name, record.remarks))
    assert wrong == []


def test_a_unit_that_is_said_otherwise_than_in_the_name_is_said(tmp_path):
    wrong = []
    table = powers() | {"p [MW]": 1e3 * powers()["p [MW]"]}
    cases = {
        "3[kW]": "unit of p: kW as said, while its name says MW",
        "p [MW][kW]": "unit of p: kW as said, while its name says MW",
    }
    for channel, remark in cases.items():
        record = read(tmp_path, table, channels={"p": channel}).records[0]
        if remark not in record.remarks or abs(record.rest.p - POWER.real[0]) > 1e-4:
            wrong.append((channel, record.rest.p, record.remarks))
    channels = {"p": "3[MW]", "v": "2[kV_LL]"}
    remarks = read(tmp_path, powers(), channels=channels).records[0].remarks
    assert (wrong, [one for one in remarks if "as said" in one]) == ([], [])


def test_a_column_that_is_told_for_two_roles_is_refused(tmp_path):
    silent = []
    for channels in ("p=3,q=3", "p=3,q=p [MW]", "p=3[kW],q=3[kvar]"):
        try:
            read(tmp_path, powers(), channels=channels)
            silent.append(channels)
        except IbridError as reason:
            if "channel 3 (p [MW]) must be told for one role; found p and q" not in str(reason):
                silent.append((channels, str(reason)))
    assert silent == []


def test_names_of_a_voltage_may_say_how_it_is_counted(tmp_path):
    wrong = []
    sizes = {"U_LL": V_BASE, "V_LL_rms": V_BASE, "U_LN": PHASE_RMS, "U_peak": V_PEAK}
    for name, size in sizes.items():
        rest = read(tmp_path, powers(f"{name} [kV]", size / 1e3)).records[0].rest
        if not np.allclose([rest.p, rest.q, rest.v], [POWER.real[0], POWER.imag[0], 1], atol=1e-4):
            wrong.append((name, rest))
    assert wrong == []


def dated(folder: Path) -> Path:
    """Voltage and powers behind a date and a time in columns of their own."""
    clocks = [f"10:00:{5 + t:09.6f}" for t in TIME]
    rows = zip(clocks, V_BASE * abs(V), POWER.real, POWER.imag, strict=True)
    lines = [
        f"2025-03-14,{clock},{v:.3f},{S_BASE / 1e3 * p:.5f},{S_BASE / 1e3 * q:.5f}"
        for clock, v, p, q in rows
    ]
    path = folder / "dated.csv"
    path.write_text("\n".join(["Date,Time,A,P (kW),Q (kvar)", *lines]), encoding="utf-8")
    return path


@pytest.mark.parametrize("clock", ["", "t=1,", "t=2,", "t=Date,", "t=Time,"])
def test_columns_behind_a_date_and_a_time_are_counted_as_in_the_file(tmp_path, clock):
    """Of date and time one clock is made, and the other columns keep their numbers."""
    channels = f"{clock}v=3[V_LL],p=4[kW],q=5[kvar]"
    events = ibrid.read_events(dated(tmp_path), channels=channels, window="none", **BASES)
    (record,) = events.records
    law = POWER[0]
    assert np.allclose([record.rest.p, record.rest.q], [law.real, law.imag], atol=1e-4)
    assert np.allclose(record.time, TIME, atol=1e-6)
    assert not any("not used" in remark or "name says" in remark for remark in record.remarks)


def test_powers_taken_for_one_another_are_remarked(tmp_path):
    """[kW] over kvar is the unit of another quantity, though both are W to a computer."""
    channels = "v=3[V_LL],p=5[kW],q=4[kvar]"
    events = ibrid.read_events(dated(tmp_path), channels=channels, window="none", **BASES)
    said = " ".join(events.records[0].remarks)
    assert "p: Q (kvar) as said, while its name says reactive power and not active power" in said
    assert "unit of p: kW as said, while its name says kvar" in said
