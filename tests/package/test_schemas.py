"""The published JSON schemas describe what the programs really write, and refuse what they never
write.
"""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from collecting import each_of
from fitted import benchmark, evaluated
from jsonschema import Draft202012Validator
from made_gap import misses_the_filter

import ibrid
from ibrid.analysis.models.linear_model import linear_model
from ibrid.export.formats import control_json
from ibrid.gap.results.files import gap_json
from ibrid.schemas import schema

FOLDER = Path(__file__).resolve().parents[2] / "ibrid" / "schemas"
NAMES = (
    "compare",
    "compare-sweeps",
    "drift",
    "fleet",
    "gap",
    "next",
    "nfp",
    "open",
    "record",
    "selection",
    "start",
    "state-space",
)


def complaints(name: str, data: Any) -> list[str]:
    """What a validator says about the JSON text of `data`."""
    plain = json.loads(json.dumps(data, allow_nan=False))
    return [
        f"{error.json_path}: {error.message[:200]}"
        for error in Draft202012Validator(schema(name)).iter_errors(plain)
    ]


def state_space() -> dict[str, Any]:
    return json.loads(control_json(linear_model(evaluated("gfl_delay", restarts=0), "p=1,q=0.3")))


def comparison() -> dict[str, Any]:
    return ibrid.compare(
        ibrid.textbook("gfl_pll_filter_exact"), ibrid.textbook("gfl_delay")
    ).to_json()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_schema_is_valid_itself(name: str):
    Draft202012Validator.check_schema(schema(name))
    assert schema(name)["properties"]["schema"]["const"] == f"ibrid.{name}/1"


def test_the_folder_holds_these_schemas():
    assert sorted(path.name for path in FOLDER.glob("*.json")) == [
        f"{name}-1.json" for name in NAMES
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gfl_pll_filter_exact", "gfl_delay", "naive"])
def test_records_of_fits_are_described(name: str):
    assert complaints("record", evaluated(name, restarts=0).to_json()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"parameters": "per-op"},
        {"parameters": "per-op", "equilibrium": "paper", "vocabulary": "paper"},
    ],
)
def test_records_of_other_settings_are_described(options: dict[str, str]):
    assert complaints("record", evaluated("gfl", restarts=0, **options).to_json()) == []


def test_records_without_a_fit_are_described():
    diagram = ibrid.Diagram()
    diagram.add("LFilter", "plant")
    assert complaints("record", ibrid.evaluate(diagram, benchmark()).to_json()) == []


@pytest.mark.slow
def test_held_out_points_and_noise_are_described():
    noisy = ibrid.add_noise(benchmark(), 60.0, rng=np.random.default_rng(1), repeats=3)
    record = ibrid.evaluate(ibrid.textbook("gfl_exact"), noisy, restarts=0, holdout_op="p=1,q=-0.3")
    assert complaints("record", record.to_json()) == []


def test_a_comparison_is_described():
    assert complaints("compare", comparison()) == []


@pytest.mark.slow
def test_a_gap_is_described():
    assert complaints("gap", gap_json(misses_the_filter())) == []


@pytest.mark.slow
def test_an_exported_state_space_is_described():
    assert complaints("state-space", state_space()) == []


@pytest.mark.slow
@each_of(
    ("name", "change", "where"),
    [
        ("record", {"outcome": "fine"}, "$.outcome"),
        ("record", {"schema": "ibrid.record/2"}, "$.schema"),
        ("record", {"nrmse": None}, "$.nrmse"),
        ("record", {"parameters": {}}, "$.parameters"),
        ("record", {"parameters": {"p=1,q=0.3": {"plant.L_F": "0.1"}}}, "$.parameters"),
        ("record", {"settings": {}}, "$.settings"),
        ("record", {"poles": {"p=1,q=0.3": [[1.0]]}}, "$.poles"),
        ("compare", {"same": "yes"}, "$.same"),
        (
            "compare",
            {"modules": {"precision": 2.0, "recall": 1.0, "f1": 1.0}},
            "$.modules.precision",
        ),
        ("state-space", {"inputs": ["v_Q", "v_D"]}, "$.inputs"),
        ("state-space", {"D": [[0, 0]]}, "$.D"),
        ("gap", {"verdict": "maybe"}, "$.verdict"),
        ("gap", {"before": {"nominal": 0.1}}, "$.before"),
    ],
)
def test_what_is_never_written_is_refused(name: str, change: dict[str, Any], where: str):
    made = {
        "record": lambda: evaluated("gfl_pll_filter_exact", restarts=0).to_json(),
        "compare": comparison,
        "state-space": state_space,
        "gap": lambda: gap_json(misses_the_filter()),
    }
    data = copy.deepcopy(made[name]()) | change
    assert any(found.startswith(where) for found in complaints(name, data))


@pytest.mark.parametrize("name", NAMES)
def test_a_document_without_a_required_member_is_refused(name: str):
    assert len(complaints(name, {})) == len(schema(name)["required"])
