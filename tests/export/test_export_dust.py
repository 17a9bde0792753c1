"""Coefficients that are rounding leave exported source as zeros; poles and response stay, and so
does what is merely small.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from given_records import NAMES, given_record

from ibrid.analysis.models.linear_model import LinearModel, linear_model, without_dust
from ibrid.export import export

OP = "p=1,q=0.3"
FREQUENCY = np.geomspace(1e-2, 1e5, 97)


def whole(model: LinearModel) -> np.ndarray:
    return np.block([[model.A, model.B], [model.C, model.D]])


def response(model: LinearModel) -> np.ndarray:
    s = 2j * np.pi * FREQUENCY[:, None, None]
    states = np.linalg.solve(
        s * np.eye(len(model.A)) - model.A, np.broadcast_to(model.B, (97, *model.B.shape))
    )
    return model.C @ states + model.D


def require_the_same(one: LinearModel, other: LinearModel) -> None:
    """Poles and response, relatively to 1e-12: a hundred times the rounding of eigenvalues and of a
    solve here.
    """
    poles, others = np.linalg.eigvals(one.A), np.linalg.eigvals(other.A)
    for pole in poles:
        assert np.abs(others - pole).min() < 1e-12 * max(abs(pole), 1e-3)
    ours, theirs = response(one), response(other)
    moved = np.linalg.norm(ours - theirs, axis=(1, 2)) / np.linalg.norm(theirs, axis=(1, 2))
    assert moved.max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_neither_poles_nor_response_move(name: str):
    model = linear_model(given_record(name), OP)
    clean = without_dust(model)
    changed = whole(clean) != whole(model)
    assert changed.any()
    assert not whole(clean)[changed].any()
    assert np.abs(whole(model)[changed]).max() < 1e-10
    require_the_same(clean, model)


def test_rounding_that_is_strewn_in_is_found_and_nothing_else():
    clean = without_dust(linear_model(given_record("paper_like"), OP))
    rows = np.abs(clean.A).max(axis=1, keepdims=True) * np.random.default_rng(5).uniform(
        -1e-17, 1e-17, clean.A.shape
    )
    dusty = replace(clean, A=np.where(clean.A == 0, rows, clean.A))
    assert np.count_nonzero(dusty.A) > 2 * np.count_nonzero(clean.A)
    np.testing.assert_array_equal(whole(without_dust(dusty)), whole(clean))


def test_a_small_coefficient_that_alone_carries_a_response_stays():
    model = linear_model(given_record("paper_like"), OP)
    # two states in a chain that nothing else joins: the current is as small as the coefficient, and
    # all there is
    A, B, C = (
        np.array([[-1e3, 0.0], [1e-13, -1e3]]),
        np.array([[1.0, 0.0], [0.0, 0.0]]),
        np.array([[0.0, 1.0], [0.0, 0.0]]),
    )
    chain = replace(model, A=A, B=B, C=C, D=np.zeros((2, 2)), states=("a", "b"))
    np.testing.assert_array_equal(whole(without_dust(chain)), whole(chain))
    # beside a direct path of 1 it is rounding
    beside = without_dust(replace(chain, D=np.eye(2)))
    assert beside.A[1, 0] == 0.0


@pytest.mark.slow
def test_written_source_has_no_dust_and_data_have_every_digit(tmp_path: Path):
    record = given_record("paper_like")
    model = linear_model(record, OP)
    dusty = r"\de-1[0-9]\b"
    for format in ("c", "modelica", "andes"):
        assert export(record, tmp_path / format, format, OP).states == model.states
        text = (tmp_path / format).read_text(encoding="utf-8")
        assert not re.findall(dusty, text), format
    export(record, tmp_path / "m.npz", "npz", OP)
    np.testing.assert_array_equal(np.load(tmp_path / "m.npz")["A"], model.A)
    assert re.findall(dusty, " ".join(map(repr, model.A.ravel().tolist())))
