"""The sweeps that ship with ibrid are what their recipes make."""

from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.recipes import recipes

from ibrid.measurement.formats.csv_file import read_csv
from ibrid.plants import benchmarks

RECIPES = {recipe.name: recipe for recipe in recipes()}


def test_every_recipe_has_its_file():
    assert set(RECIPES) <= set(benchmarks())
    assert len([name for name in benchmarks() if name.startswith("published_")]) >= 4
    assert len([name for name in benchmarks() if name.startswith("random_")]) == 10


@each_of("name", RECIPES)
def test_shipped_file_equals_its_recipe(name):
    shipped, made = read_csv(benchmarks()[name]), RECIPES[name].sweep()
    assert shipped.names == made.names
    assert (shipped.f0_hz, shipped.power_node) == (made.f0_hz, made.power_node)
    for old, new in zip(shipped.points, made.points, strict=True):
        assert old.op == new.op
        np.testing.assert_array_equal(old.frequency, new.frequency)
        # rounding of another linear algebra library at a lightly damped resonance
        error = np.linalg.norm(old.admittance - new.admittance, axis=(1, 2)) / np.linalg.norm(
            new.admittance, axis=(1, 2)
        )
        assert error.max() < 1e-9


@each_of("name", RECIPES)
def test_shipped_file_tells_how_it_was_made_and_what_is_inside(name):
    text = Path(benchmarks()[name]).read_text(encoding="utf-8")
    assert "make_data.py" in text
    for parameter, value in RECIPES[name].plant.diagram_values.items():
        assert f"{parameter} = {value!r}" in text


def test_benchmark_is_the_one_the_contract_fixes():
    values = RECIPES["paper_like"].plant.diagram_values
    expected = {
        "plant.L_F": 0.15,
        "plant.R_F": 0.005,
        "plant.C_F": 0.066,
        "plant.L_g": 0.15,
        "plant.R_g": 0.01,
    }
    expected |= {
        "pll.kP_pll": 60,
        "pll.kI_pll": 1400,
        "pll_filter.omega_c": 2 * np.pi * 500,
        "decoupling.L": 0.15,
    }
    expected |= {
        "power.kP": 0.02,
        "power.kI": 20,
        "current.kP": 0.5,
        "current.kI": 0.04 * 2 * np.pi * 60,
    }
    assert dict(values) == pytest.approx(expected)
    point = read_csv(benchmarks()["paper_like"]).points[0]
    assert (len(point.frequency), point.frequency[0], point.frequency[-1]) == (16, 5.0, 5000.0)
