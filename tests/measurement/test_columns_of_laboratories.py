"""Recordings and sweeps as further programs, instruments and languages write them, and what a
sentence must say where something is missing or wrong.
"""

from pathlib import Path

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement.importing.doubts.transformer_ratio import transformer_doubts
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.read_events import read_events

TIME = np.arange(0.0, 0.4, 2e-4)
BASE_V = 20e3 * np.sqrt(2 / 3)
BASE_I = 2.5e6 / (1.5 * BASE_V)
DIP = np.where((TIME > 0.1) & (TIME < 0.25), 0.7, 1.0)
POWER = 1.0 + 0.3j
SAID = {"base": "2.5MVA,20kV", "f0_hz": 50.0}


def phases(values: np.ndarray) -> np.ndarray:
    """(3, n) of a dq signal at 50 Hz."""
    turns = np.exp(1j * (2 * np.pi * 50 * TIME - 2 * np.pi / 3 * np.arange(3)[:, None]))
    return np.real(values * turns)


def recorded(folder: Path, names: str, order=(0, 1, 2), i_factor: float = 1.0, above: str = ""):
    """A file with a dip, the currents in another order of phases and times a factor."""
    v = BASE_V * phases(DIP)
    i = i_factor * BASE_I * phases(np.conj(POWER) / DIP * DIP)[[*order]]
    rows = [",".join(f"{x:.6f}" for x in row) for row in np.column_stack([TIME, *v, *i]).tolist()]
    (folder / "dip.csv").write_text("\n".join([above + names, *rows]) + "\n")
    return folder / "dip.csv"


@each_of(
    "names",
    [
        "t,va_V,vb_V,vc_V,ia_A,ib_A,ic_A",
        "time_s,Va_V,Vb_V,Vc_V,Ia_A,Ib_A,Ic_A",
        "Time [s],U_L1_V,U_L2_V,U_L3_V,I_L1_A,I_L2_A,I_L3_A",
        "t_s,vPCCa_V,vPCCb_V,vPCCc_V,iPCCa_A,iPCCb_A,iPCCc_A",
    ],
)
def test_units_behind_an_underscore_are_those_of_voltages_and_currents(tmp_path, names):
    record = read_events(recorded(tmp_path, names), **SAID)["dip"]
    assert (record.rest.p, record.rest.q) == pytest.approx((1.0, 0.3), abs=1e-3)


def test_currents_of_a_secondary_side_are_remarked_with_the_option_that_multiplies_them(tmp_path):
    names = "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    (said,) = contradictions(read_events(recorded(tmp_path, names, i_factor=0.01), **SAID))
    assert "secondary side" in said
    assert "--ratio i=" in said
    assert contradictions(read_events(recorded(tmp_path, names, i_factor=0.2), **SAID)) == ()


def test_voltages_of_a_secondary_side_are_refused_with_the_option(tmp_path):
    path = recorded(tmp_path, "t,va [mV],vb [mV],vc [mV],ia [A],ib [A],ic [A]")
    with pytest.raises(SweepError, match="--ratio v="):
        read_events(path, **SAID)


@each_of("order, first", [((2, 0, 1), "ib, ic, ia"), ((1, 2, 0), "")])
def test_currents_of_other_phases_are_told_from_a_current_that_counts_in(tmp_path, order, first):
    """At p = 1, q = 0.3 the current lags 17 degrees: by a third of a turn either way it is at 103
    or 137 degrees, which the third of a turn brings back.
    """
    names = "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    (said,) = contradictions(read_events(recorded(tmp_path, names, order), **SAID))
    assert "not in the order of those of the voltage (17 degrees once" in said
    assert first in said
    assert "--channels" in said


def test_the_order_that_the_sentence_names_puts_the_phases_right(tmp_path):
    names = "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]"
    for order in ((2, 0, 1), (1, 2, 0)):
        path = recorded(tmp_path, names, order)
        (said,) = contradictions(read_events(path, **SAID))
        taken = said.split("degrees once ")[1].split(" are taken")[0].split(", ")
        place = {"ia": 5, "ib": 6, "ic": 7}
        channels = ",".join(f"{role}={place[one]}" for role, one in zip(place, taken, strict=True))
        record = read_events(path, channels=channels, **SAID)["dip"]
        assert (record.rest.p, record.rest.q) == pytest.approx((1.0, 0.3), abs=1e-3)


@each_of(
    "comment, letter",
    [
        ("CH1-CH3 differential probe 1000:1, CH4-CH6 current clamp 10 mV/A", "v"),
        ("CH1-CH3 differential probe 1000:1 CH4-CH6 current clamp 10 mV/A", "v"),
        ("CH4 Stromzange 1000:1 Wandler, CH1 Spannung direkt", "i"),
        ("HV probe 2000:1; Rogowski coils on CH4-CH6", "v"),
        ("current transformer, ratio 1000/5", "i"),
    ],
)
def test_a_ratio_belongs_to_what_its_own_words_measure(comment, letter):
    assert [one.letter for one in transformer_doubts([comment])] == [letter]


ENTRIES = {"dd": (0, 0), "dq": (0, 1), "qd": (1, 0), "qq": (1, 1)}
SWEEP = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
FREQUENCY = np.array(SWEEP.points[0].frequency)
Z_BASE = 690.0**2 / 2.75e6
ADMITTANCE = np.array(SWEEP.points[0].admittance) / Z_BASE
IMPEDANCE = -np.linalg.inv(ADMITTANCE)
OUT = {"f0_hz": 60.0, "current": "out", "q_axis": "leads", "power_node": "capacitor"}
IN = {**OUT, "current": "in"}
BASE = {"base": "2.75MVA,690V"}
REST = {"p": 1.0, "q": 0.3}


def scan(above: str = "", matrix: np.ndarray = ADMITTANCE, unit: str = "S", mark: str = ",") -> str:
    """A table of real and imaginary parts below some lines."""
    names = [f"Y{e}_{part} [{unit}]" for e in ENTRIES for part in ("re", "im")]
    values = np.ascontiguousarray(matrix).reshape(-1, 4).view(float)
    rows = [mark.join(f"{x:.9g}" for x in (f, *v)) for f, v in zip(FREQUENCY, values, strict=True)]
    return "\n".join([above + mark.join(["freq_hz", *names]), *rows]) + "\n"


def imported(folder: Path, text: str, name: str = "scan.csv", **said: object):
    (folder / name).write_text(text, encoding="utf-8")
    return import_files([folder / name], **said)


def error(sweep, point: int = 0) -> float:
    """Largest part of |Y| that a sweep is off the truth."""
    truth = np.array(SWEEP.points[point].admittance)
    found = np.array(sweep.points[point].admittance)
    return float(np.abs(found - truth).max() / np.abs(truth).max())


@each_of(
    "words, states",
    [
        ("Device;WR 2,75 MVA\nBemessungsspannung;690 V\n", "2.75MVA,690V"),
        ("# Rated power: 2750 kVA\n# Rated voltage: 690 V\n", "2.75MVA,690V"),
        ("# Sn = 2.75 MVA, Un = 0.69 kV\n", "2.75MVA,690V"),
        ("Essai : onduleur 2.75 MVA / 690 V\n", "2.75MVA,690V"),
        ("# Nennscheinleistung: 2750 kVA\n# Nennspannung: 690 V\n", "2.75MVA,690V"),
        ("# Puissance nominale : 2750 kVA, tension nominale : 690 V\n", "2.75MVA,690V"),
        ("# WTG 2.75 MVA scan\n", "2.75MVA"),
    ],
)
def test_a_base_that_is_said_otherwise_than_a_rating_in_words_is_remarked(tmp_path, words, states):
    text = scan(words, mark=";" if ";" in words else ",")
    said = imported(tmp_path, text, base="3MVA,400V", **OUT, **REST)
    shown = [one for one in said.remarks if one.startswith("base: ")]
    assert shown == [f"base: 3MVA,400V as said, while {tmp_path / 'scan.csv'} states {states}"]
    agreed = imported(tmp_path, text, **BASE, **OUT, **REST)
    assert [one for one in agreed.remarks if one.startswith("base: ")] == []


def test_a_rating_of_another_device_is_no_base(tmp_path):
    for words in ("# Trafo 3.15 MVA / 690 V\n", "# grid: 100 MVA\n", "# 2 MVA and 3 MVA units\n"):
        said = imported(tmp_path, scan(words), **BASE, **OUT, **REST)
        assert [one for one in said.remarks if one.startswith("base: ")] == []


def test_the_question_for_a_base_proposes_the_rating_of_the_words(tmp_path):
    text = scan("# onduleur 2.75 MVA / 690 V\n")
    assert "--base 2.75MVA,690V" in imported(tmp_path, text, **OUT, **REST).asked
    called = imported(tmp_path, scan("# base: 2.75 MVA, 690 V\n"), **OUT, **REST)
    assert error(called.answered()) < 1e-6


def test_the_base_of_a_recording_that_its_comments_say_otherwise_is_remarked(tmp_path):
    path = recorded(
        tmp_path, "t,va [V],vb [V],vc [V],ia [A],ib [A],ic [A]", above="# Sn = 3 MVA, Un = 20 kV\n"
    )
    remarks = read_events(path, **SAID)["dip"].remarks
    assert "base: 2.5MVA,20kV as said, while its words state 3MVA,20kV" in remarks
