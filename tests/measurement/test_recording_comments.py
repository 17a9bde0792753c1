"""Bases, frequency and ratios of transformers in the comments of a recording."""

from pathlib import Path

import numpy as np
import pytest

import ibrid

TIME = np.arange(0, 0.2, 5e-4)
PHASES = 2 * np.pi * (50 * TIME[:, None] - np.arange(3) / 3)


def recording(folder: Path, *comments: str) -> Path:
    """10 kVA, 400 V at half its current, in V and A."""
    volts = 400 * np.sqrt(2 / 3) * np.cos(PHASES)
    amperes = 0.5 * 10e3 / 400 * np.sqrt(2 / 3) * np.cos(PHASES)
    rows = np.column_stack([TIME, volts, amperes])
    head = "t [s],va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    lines = [*(f"# {comment}" for comment in comments), head]
    lines += [",".join(f"{cell:.7g}" for cell in row) for row in rows.tolist()]
    path = folder / "recording.csv"
    path.write_text("\n".join(lines))
    return path


def test_bases_in_the_words_of_a_data_sheet_are_read(tmp_path):
    wrong = []
    for comments in (
        ("Sn = 10 kVA", "Un = 400 V", "fn = 50 Hz"),
        ("s_base_va: 10 kVA", "v_base_v: 0.4 kV", "f0_hz: 50 Hz"),
        ("Rating: S_base = 0.01 MVA, V_base = 400 V, f0 = 50 Hz",),
        ("s_base_va: 10e3", "v_base_v: 400", "f0_hz: 50"),
    ):
        events = ibrid.read_events(recording(tmp_path, *comments))
        read = (events.s_base_va, events.v_base_v, events.f0_hz)
        p = events.records[0].rest.p
        if read != pytest.approx((10e3, 400.0, 50.0)) or p != pytest.approx(0.5, abs=1e-3):
            wrong.append((comments, read, p))
    assert wrong == []


def test_what_is_told_wins_over_the_words_of_comments(tmp_path):
    path = recording(tmp_path, "Sn = 20 kVA", "Un = 400 V")
    assert ibrid.read_events(path, base="10kVA,400V", f0_hz=50.0).s_base_va == 10e3


def test_ratios_of_transformers_and_secondary_values_are_said(tmp_path):
    silent = []
    for comment in (
        "CT 1000/5",
        "CT ratio 200:1",
        "VT: 20000 V / 100 V",
        "current transformer 600 A : 5 A",
        "Stromwandler 1000/1 A",
        "values are secondary",
        "Sekundärwerte; sekundär gemessen",
    ):
        events = ibrid.read_events(recording(tmp_path, comment), base="10kVA,400V", f0_hz=50.0)
        if not any("primary side" in note for note in events.notes):
            silent.append(comment)
    assert silent == []


def test_other_numbers_beside_slashes_are_no_ratios(tmp_path):
    loud = []
    for comment in ("date 12/05/2026", "fault at bus 3/4", "scope: 10 MS/s", "PT1 filter"):
        events = ibrid.read_events(recording(tmp_path, comment), base="10kVA,400V", f0_hz=50.0)
        if any("primary side" in note for note in events.notes):
            loud.append(comment)
    assert loud == []
