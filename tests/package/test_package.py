"""The package as users meet it: its names, its version and what ships with it."""

import importlib.metadata
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from collecting import each_of

import ibrid

ROOT = Path(__file__).resolve().parents[2]


@each_of("name", ibrid.__all__)
def test_every_public_name_is_there_and_documented(name: str):
    value = getattr(ibrid, name)
    if callable(value):
        assert value.__doc__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="ibrid has no nothing"):
        _ = ibrid.nothing  # pyright: ignore[reportAttributeAccessIssue]


def test_the_version_is_the_same_everywhere():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "version"
    ]
    assert ibrid.__version__ == declared == importlib.metadata.version("ibrid")


def test_importing_ibrid_loads_nothing_heavy():
    code = (
        "import ibrid, sys; print([m for m in ('numpy', 'scipy', 'casadi', 'control', 'numba') if "
        "m in sys.modules])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"


def test_the_benchmark_and_the_textbook_diagrams_are_found():
    assert "paper_like" in ibrid.benchmarks()
    assert {"naive", "gfl", "gfl_exact"} <= set(ibrid.textbook_names())
