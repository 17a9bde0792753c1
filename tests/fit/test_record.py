"""The record: the JSON of the contract, there and back through a file, and the model that is
rebuilt from it.
"""

import copy
import json
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from fitted import benchmark, evaluated, measured

import ibrid
from ibrid.errors import IbridError, OperatingPointError
from ibrid.evaluation.record import Record, read_record
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.reading.wiring import wire

OPS = ("p=1,q=0.3", "p=1,q=-0.3")
NUMBER = (int, float)
#: Keys of the contract and the JSON types they have in a record that is ok.
CONTRACT = {
    "schema": str,
    "outcome": str,
    "reasons": list,
    "nrmse": NUMBER,
    "reward": NUMBER,
    "nrmse_by_op": dict,
    "nrmse_by_band": dict,
    "nrmse_by_entry": dict,
    "share_by_band": dict,
    "holdout": dict,
    "modules": int,
    "order": int,
    "residual_modules": int,
    "free_parameters": int,
    "parameters": dict,
    "at_bound": list,
    "stable": dict,
    "poles": dict,
    "identifiability": list,
    "program": str,
    "settings": dict,
    "seconds": NUMBER,
}
WAYS = {
    "ok": lambda: evaluated("gfl_delay", restarts=0),
    "per-op in paper mode": lambda: evaluated(
        "gfl_pll_filter", parameters="per-op", equilibrium="paper", vocabulary="paper", restarts=0
    ),
    "invalid": lambda: evaluated("gfl_exact", vocabulary="paper"),
    "failed": lambda: ibrid.evaluate(ibrid.textbook("gfl_exact"), far_from_any_operating_point()),
}


def far_from_any_operating_point():
    points = tuple(replace(point, op=replace(point.op, p=5.0)) for point in benchmark().points)
    return replace(benchmark(), points=points)


def without_seconds(record: Record) -> dict:
    return {key: value for key, value in record.to_json().items() if key != "seconds"}


def numbers_in(value) -> list[float]:
    if isinstance(value, dict):
        return [number for entry in value.values() for number in numbers_in(entry)]
    if isinstance(value, list):
        return [number for entry in value for number in numbers_in(entry)]
    return [value] if isinstance(value, NUMBER) and not isinstance(value, bool) else []


# the JSON


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_every_outcome_is_strict_json_with_the_keys_of_the_contract(way):
    record = WAYS[way]()
    data = json.loads(json.dumps(record.to_json(), allow_nan=False))
    assert set(CONTRACT) <= set(data)
    assert data["schema"] == "ibrid.record/1"
    assert data["outcome"] in ("ok", "invalid", "failed")
    assert np.isfinite(numbers_in(data)).all()
    assert bool(data["reasons"]) == (data["outcome"] != "ok")
    for reason in data["reasons"]:
        assert isinstance(reason, str)
        assert "\n" not in reason
    for key, kind in CONTRACT.items():
        if data["outcome"] == "ok" or key not in ("nrmse", "parameters"):
            assert isinstance(data[key], kind), key
            assert isinstance(data[key], bool) is False
    again = Record.from_json(data)
    assert again.to_json() == record.to_json()


def test_the_dictionaries_have_the_keys_of_the_contract():
    data = evaluated("gfl_delay", restarts=0).to_json()
    for key in ("nrmse_by_op", "parameters", "stable", "poles", "intervals"):
        assert list(data[key]) == list(OPS)
    for key in ("nrmse_by_band", "share_by_band"):
        assert list(data[key]) == ["5-50", "50-500", "500-2000", "2000-5000"]
    assert list(data["nrmse_by_entry"]) == ["dd", "dq", "qd", "qq"]
    assert all(isinstance(value, bool) for value in data["stable"].values())
    assert all(len(pole) == 2 for poles in data["poles"].values() for pole in poles)
    assert data["settings"]["operating_points"]["p=1,q=-0.3"] == {"p": 1.0, "q": -0.3, "v": 1.0}
    assert Path(data["settings"]["data"]).name == "paper_like.csv"
    for op, values in data["parameters"].items():
        assert set(values) == set(data["boxes"]) == set(data["intervals"][op])


@pytest.mark.slow
def test_a_record_goes_through_a_file_unchanged(tmp_path):
    for name in ("gfl_delay", "naive"):
        record = evaluated(name, restarts=0)
        record.write(tmp_path / "record.json")
        again = read_record(tmp_path / "record.json")
        assert again.to_json() == record.to_json()
        assert again.vocabulary == VOCABULARY
        for op in OPS:
            np.testing.assert_array_equal(again.state_space(op).A, record.state_space(op).A)
        record.write(tmp_path / "record.json")  # over the first
        assert [path.name for path in tmp_path.iterdir()] == ["record.json"]


def test_a_record_survives_pickling_and_copying():
    record = evaluated("gfl_delay", restarts=0)
    assert pickle.loads(pickle.dumps(record)).to_json() == record.to_json()
    assert copy.deepcopy(record) == record


@pytest.mark.slow
def test_the_program_in_the_record_is_the_given_one_and_evaluates_to_the_same_record():
    record = evaluated("gfl_exact")
    assert record.program == ibrid.program_text(ibrid.textbook("gfl_exact"))
    assert without_seconds(ibrid.evaluate(record.diagram, benchmark())) == without_seconds(record)


# what is not a record


def broken(**changes) -> dict:
    data = copy.deepcopy(evaluated("gfl_delay", restarts=0).to_json())
    for path, value in changes.items():
        *parents, last = path.split("__")
        place = data
        for parent in parents:
            place = place[parent]
        if value is None:
            del place[last]
        else:
            place[last] = value
    return data


@pytest.mark.slow
@each_of(
    ("changes", "words"),
    [
        ({"schema": "ibrid.gap/1"}, r"has the schema 'ibrid\.record/1', found 'ibrid\.gap/1'"),
        ({"schema": None}, "found none"),
        ({"program": None}, "lacks program"),
        ({"outcome": None}, "lacks outcome"),
        ({"nrmse": "small"}, "has nrmse that must be a finite number.*found 'small'"),
        ({"reasons": "none"}, "has reasons that must be a list, found 'none'"),
        ({"parameters": []}, "has parameters that must be a table"),
        ({"poles": 3}, "has poles that must be a table, found 3"),
        ({"order": True}, "has order that must be a whole number, found True"),
        (
            {"settings": {}},
            r"lacks, in settings, parameters, equilibrium, power_node, f0_hz, operating_points, .*pade_orders",
        ),
        ({"settings__f0_hz": None}, "lacks, in settings, f0_hz"),
        (
            {"settings__f0_hz": -60},
            r"settings, f0_hz that must be as the schema says \(exclusiveMinimum 0\), found -60",
        ),
        ({"settings__f0_hz": "60"}, "f0_hz that must be a finite number, found '60'"),
        (
            {"settings__equilibrium": "exakt"},
            "equilibrium that must be 'exact' or 'paper', found 'exakt'",
        ),
        (
            {"settings__power_node": "grid"},
            "power_node that must be 'capacitor' or 'pcc', found 'grid'",
        ),
        (
            {"settings__pade_orders": {"delay": 2.5}},
            "pade_orders, delay that must be a whole number, found 2.5",
        ),
        (
            {"settings__operating_points": {}},
            "lacks the parameters, or p, q and v, of the operating point p=1,q=0",
        ),
        (
            {"settings__operating_points__p=1,q=0.3": {"p": 1.0, "q": 0.3}},
            "lacks, in settings, operating_points, p=1,q=0.3, v",
        ),
        (
            {"settings__operating_points__p=1,q=0.3__v": "1"},
            "p=1,q=0.3, v that must be a finite number, found '1'",
        ),
        ({"parameters": {}}, "has parameters that must be as the schema says"),
        ({"parameters__p=1,q=0.3": [1, 2]}, "that must be a table"),
        (
            {"parameters__p=1,q=0.3__plant.L_F": float("nan")},
            "plant.L_F that must be a finite number, found nan",
        ),
        (
            {"parameters__p=1,q=0.3__plant.L_F": "0.1"},
            "plant.L_F that must be a finite number, found '0.1'",
        ),
    ],
)
def test_what_is_not_a_record_is_refused_in_one_sentence(changes, words):
    with pytest.raises(IbridError, match=words) as raised:
        Record.from_json(broken(**changes))
    assert "\n" not in str(raised.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"reasons": [3]}, "has reasons, 0 that must be text, found 3"),
        ({"warnings": [None]}, "has warnings, 0 that must be text, found null"),
        ({"at_bound": [{}]}, "has at_bound, 0 that must be text, found {}"),
        ({"identifiability": [["a"]]}, "has identifiability, 0 that must be text"),
        ({"seconds": float("nan")}, "has seconds that must be a finite number, found nan"),
        (
            {"twins": [{"plant.L_F": "x"}]},
            "has twins, 0, plant.L_F that must be a finite number, found 'x'",
        ),
        ({"twins": [3]}, "has twins, 0 that must be a table, found 3"),
    ],
)
def test_a_damaged_part_is_named(changes, words):
    with pytest.raises(IbridError, match=re.escape(words)):
        Record.from_json(broken(**changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"parameters__p=1,q=0.3__plant.L_F": -1.0},
            "has plant.L_F = -1 at p=1,q=0.3, outside its box",
        ),
        ({"parameters__p=1,q=0.3__plant.L_F": 1e90}, "outside its box"),
        (
            {"parameters__p=1,q=0.3__plant.L_F": 1e308},
            "has 1e+308 in parameters, more than any answer holds",
        ),
        ({"poles__p=1,q=0.3": [[1e308, 1.0]]}, "has 1e+308 in poles, more than any answer holds"),
    ],
)
def test_a_number_that_no_fit_can_have_left_is_refused(changes, words):
    with pytest.raises(IbridError, match=re.escape(words)):
        Record.from_json(broken(**changes))


@pytest.mark.parametrize("data", [None, 3, "record", [], [{"schema": "ibrid.record/1"}], {}])
def test_other_json_is_refused(data):
    with pytest.raises(IbridError, match="schema"):
        Record.from_json(data)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters__p=1,q=0.3__plant.C_F": None}, r"parameters at p=1,q=0\.3 lack plant\.C_F"),
        ({"settings__pade_orders": {}}, "pade_orders lack delay"),
        ({"program": "def build(g):\n    g.add('LCL')\n"}, "line 2"),
    ],
)
def test_a_model_that_cannot_be_rebuilt_says_what_is_lacking(changes, words):
    record = Record.from_json(broken(**changes))
    with pytest.raises(IbridError, match=words):
        record.state_space("p=1,q=0.3")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not JSON"),
        (b"{", "is not JSON"),
        (b"\xff\xfe\x00", "is not JSON"),
        (b"[" * 100000, "is not JSON"),
        (b"{}", "schema"),
    ],
)
def test_a_file_that_is_no_record_is_refused_with_its_name(tmp_path, content, words):
    path = tmp_path / "other.json"
    path.write_bytes(content)
    with pytest.raises(IbridError, match=rf"other\.json.*{words}"):
        read_record(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(IbridError, match="cannot be read"):
        read_record(tmp_path / "none.json")
    with pytest.raises(IbridError, match="cannot be read"):
        read_record(tmp_path)


# the model


@pytest.mark.nightly
@each_of("name", sorted(set(ibrid.textbook_names()) - {"gfl_delay", "gfl_l_filter_delay"}))
def test_the_state_space_has_the_response_of_the_record(name):
    record = evaluated(name, restarts=0)
    frequency = np.logspace(-1, 4, 30)
    for op in OPS:
        system = record.state_space(op)
        answer = np.moveaxis(system(2j * np.pi * frequency), 2, 0)
        exact = record.response(op, frequency)
        # python-control's own rounding at the ends of the band
        assert (
            np.linalg.norm(answer - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))
        ).max() < 1e-7
        assert list(system.input_labels) == ["v_D", "v_Q"]
        assert list(system.output_labels) == ["i_D", "i_Q"]
        assert all("." in state for state in system.state_labels)


@pytest.mark.slow
def test_with_a_delay_the_state_space_follows_the_exact_response_to_a_degree():
    sweep = measured(["p=1,q=0.3", "p=1,q=-0.3"])
    text = ibrid.program_text(ibrid.textbook("gfl_delay")).replace(
        '"Delay", "delay"', '"Delay", "delay", T_d=1.5e-4'
    )
    record = ibrid.evaluate(ibrid.parse_program(text), sweep, restarts=0)
    order = record.settings["pade_orders"]["delay"]
    assert order == 5  # 150 us and 5 kHz
    assert record.order == 12 + 2 * order  # the order of the matrices, both axes
    assert record.order == record.state_space("p=1,q=0.3").nstates
    frequency = np.logspace(0, np.log10(5000), 40)
    answer = np.moveaxis(record.state_space("p=1,q=0.3")(2j * np.pi * frequency), 2, 0)
    exact = record.response("p=1,q=0.3", frequency)
    error = np.linalg.norm(answer - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))
    # one degree is 0.0175; a resonance of the loop can multiply it
    assert np.median(error) < 1e-3
    assert error.max() < 0.1


@pytest.mark.nightly
@each_of("name", ibrid.textbook_names())
def test_poles_and_stability_are_those_of_the_exported_matrices(name):
    record = evaluated(name, restarts=0)
    for op in OPS:
        expected = np.linalg.eigvals(record.state_space(op).A)
        found = np.array(record.poles[op]) @ np.array([1, 1j])
        assert len(found) == record.order == len(expected)
        for pole in expected:
            assert np.abs(found - pole).min() <= 1e-6 * max(abs(pole), 1.0)
        assert record.stable[op] == bool(expected.real.max() < 1e-6)


def test_an_unstable_device_is_fitted_and_called_unstable():
    record = ibrid.evaluate(
        ibrid.textbook("gfl_pll_filter_exact"), measured(["p=-0.5,q=0", "p=1,q=0.3"])
    )
    assert record.stable == {"p=-0.5,q=0": False, "p=1,q=0.3": True}
    assert max(pole[0] for pole in record.poles["p=-0.5,q=0"]) == pytest.approx(7.82, abs=0.01)


def test_counts_are_those_of_the_program():
    record = evaluated("gfl_pll_filter_exact")
    diagram = ibrid.textbook("gfl_pll_filter_exact")
    assert record.modules == len(diagram.instances) == 13
    assert record.order == 13
    assert record.residual_modules == 0
    assert record.free_parameters == 13
    # i_ref and the measured current before the PI; PI, decoupling and feedforward before the filter
    assert record.sums == 2
    assert record.sums == sum(
        len(sources) > 1 for sources in wire(diagram, VOCABULARY).sources.values()
    )


@pytest.mark.slow
def test_residual_blocks_are_counted():
    text = ibrid.program_text(ibrid.textbook("gfl_pll_filter"))
    text = text.replace('"LPF1", "pll_filter"', '"Pade1", "pll_filter"')
    record = ibrid.evaluate(ibrid.parse_program(text), benchmark(), restarts=0)
    assert record.residual_modules == 1
    assert record.free_parameters == evaluated("gfl_pll_filter").free_parameters


def test_a_record_of_before_that_ran_out_of_time_is_unfinished():
    old = {**WAYS["failed"]().to_json(), "outcome": "timeout", "seconds": 60.0}
    record = Record.from_json(old)
    assert record.outcome == "unfinished"
    assert record.to_json()["outcome"] == "unfinished"


def test_a_file_says_the_same_whatever_a_clock_does():
    record = evaluated("gfl_delay", restarts=0)
    slow = replace(record, seconds=1e6)
    assert slow == record
    assert slow.to_json() == record.to_json()


@pytest.mark.parametrize("way", ["invalid", "failed"])
def test_without_a_fit_there_is_no_model_and_the_reason_is_repeated(way):
    record = WAYS[way]()
    assert record.outcome == way
    for ask in (record.state_space, lambda op: record.response(op, np.array([50.0]))):
        with pytest.raises(IbridError, match=f"has no fit \\(outcome {way}: "):
            ask("p=1,q=0.3")


def test_another_operating_point_is_refused_with_the_near_ones():
    with pytest.raises(OperatingPointError, match="did you mean p=1,q="):
        evaluated("naive").state_space("p=1,q=0.4")
    with pytest.raises(OperatingPointError, match="did you mean p=1,q="):
        evaluated("naive").response("p=1,q=0.4", np.array([50.0]))


def test_a_record_without_a_noise_floor_or_holdout_says_so_by_null_and_empty():
    data = evaluated("naive").to_json()
    assert data["noise_floor"] is None
    assert data["holdout"] == {}


@pytest.mark.parametrize(
    "wrong", [{"warnings": 5}, {"nrmse": "x"}, {"reasons": np.array([1])}, {"nrmse": []}]
)
def test_a_record_that_is_made_of_other_kinds_is_refused(wrong):
    with pytest.raises(IbridError, match=next(iter(wrong))):
        Record("ok", **wrong)
