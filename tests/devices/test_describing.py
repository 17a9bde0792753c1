"""What is guessed of a model file stands on what its parameters say."""

import pytest

from ibrid.devices.describing import OfferedVariable, stated_by_parameters

GUESSED = {"f0_hz": 50.0, "s_base_va": 1e6, "v_base_v": 400.0}


def offered(*ports: tuple[str, str, str]) -> dict[str, OfferedVariable]:
    return {name: OfferedVariable(name, unit, "", usual) for name, unit, usual in ports}


def test_bases_and_nominal_frequency_are_those_that_parameters_say():
    doubts: list[str] = []
    ports = offered(
        ("VLLbase", "V", "600"),
        ("w_nom", "rad/s", "376.99"),
        ("Sbase", "MVA", "2.5"),
        ("kp", "", "3"),
    )
    stated = stated_by_parameters(ports, GUESSED, doubts)
    assert stated == pytest.approx({"f0_hz": 60.0, "v_base_v": 600.0, "s_base_va": 2.5e6})
    (words,) = doubts
    assert "f0_hz from the parameter w_nom" in words
    assert "v_base_v from the parameter VLLbase" in words


def test_what_is_no_number_or_absurd_or_not_asked_for_is_not_taken():
    ports = offered(("VLLbase", "V", "600"), ("f0", "Hz", "none"), ("w_nom", "pu", "1"))
    doubts: list[str] = []
    assert stated_by_parameters(ports, {"f0_hz": 50.0}, doubts) == {}
    assert doubts == []
