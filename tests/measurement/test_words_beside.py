"""Words beside a base or a power that make another of it, and numbers that contradict each other,
are said; what is doubted is asked for.
"""

import pytest

import ibrid
from ibrid.measurement.importing.told import base_of, doubts_beside, told_beside


def told(*notes, stem="scan"):
    return {key: one[0] for key, one in told_beside(stem, notes).items()}


def test_bases_of_another_kind_are_not_taken():
    wrong = []
    for note in (
        "V_base: 230.94 V LN rms",
        "Un = 230 V (phase)",
        "Rated voltage: 230 V (line-neutral)",
        "base voltage (L-N) = 230.94 V",
        "Un: 230/400 V",
        "base voltage (peak) = 326.6 V",
        "S_base: 3.333 kVA per phase",
    ):
        if {"v_base_v", "s_base_va"} & told(note).keys() or not doubts_beside("scan", [note]):
            wrong.append((note, told(note)))
    assert wrong == []


def test_plain_bases_are_taken():
    wrong = []
    for note, expected in {
        "S_base: 10 kVA, V_base: 400 V": {"s_base_va": 10e3, "v_base_v": 400.0},
        "three-phase inverter, Sn = 10 kVA": {"s_base_va": 10e3},
        "Un = 400 V (line to line)": {"v_base_v": 400.0},
        "Un = 400 V phase-to-phase": {"v_base_v": 400.0},
        "Rating: 10 kVA / 400 V": {"s_base_va": 10e3},
        "Sn = 10 kVA (3-phase); Un = 400 V rms": {"s_base_va": 10e3, "v_base_v": 400.0},
    }.items():
        if told(note) != expected or doubts_beside("scan", [note]):
            wrong.append((note, told(note), doubts_beside("scan", [note])))
    assert wrong == []


def test_powers_that_words_may_turn_are_not_taken():
    wrong = []
    for note, key in {
        "P = -1 (load convention)": "p",
        "Q = 0.3 pu (absorbed)": "q",
        "Q = 0.3 ind": "q",
        "P = 10 kW per phase": "p",
        "P = 1/2": "p",
    }.items():
        if key in told(note) or not doubts_beside("scan", [note]):
            wrong.append((note, told(note)))
    for stem in ("scan_P10MW_Q3Mvar_cap", "scan_P10MW_Q3Mvar_ind"):
        if "q" in told(stem=stem) or told(stem=stem)["p"] != 10e6 or not doubts_beside(stem, []):
            wrong.append((stem, told(stem=stem)))
    assert wrong == []


def test_names_of_powers_may_follow_each_other_without_a_mark():
    assert told("P = 0,8 Q = 0,1") == pytest.approx({"p": 0.8, "q": 0.1})
    assert told("P=1,0 Q=0,30 V=1,0") == pytest.approx({"p": 1.0, "q": 0.3, "v": 1.0})
    assert told("P = 8 kW Q = 1 kvar") == pytest.approx({"p": 8e3, "q": 1e3})
    assert doubts_beside("scan", ["P = 0.8 Q = 0.1 leaving out nothing"]) == ()


def test_the_quarter_of_a_year_is_no_reactive_power():
    assert told(stem="2024-Q1_P1") == {"p": 1.0}
    assert told(stem="scan_2024_Q1_v2_p1") == {"p": 1.0}
    assert told(stem="scan_2024_P1_Q0.3") == pytest.approx({"p": 1.0, "q": 0.3})


def test_contradicting_numbers_are_said():
    notes = ["Transformer: Sn = 20 kVA, Vn = 400 V", "Inverter: Sn = 10 kVA, Vn = 400 V"]
    assert told(*notes)["s_base_va"] == 20e3
    assert any("10 kVA" in one for one in doubts_beside("scan", notes))
    assert doubts_beside("scan", ["Sn = 10 kVA", "S_base: 10000"]) == ()


def test_a_base_with_letters_that_are_no_unit_is_refused():
    for text in ("10kVA,230.94Vln", "10kVA,326.6Vpeak", "10kVA,400Vpp", "10kVAx,400V"):
        with pytest.raises(ibrid.IbridError, match="10kVA,400V"):
            base_of(text, "--base")
    assert base_of("10kVA,400Vrms", "--base") == (10e3, 400.0)
