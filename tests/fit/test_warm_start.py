"""Fits that begin from known values: of another record, or of a diagram that differs little."""

import dataclasses

import numpy as np
import pytest
from fitted import TRUE, benchmark

import ibrid
from ibrid.fit.settings import FitSettings

#: No start of its own gets far: what comes out is what the warm values give.
LAZY = FitSettings(
    starts=1,
    kept=1,
    kept_misfit=1,
    halving=(),
    restarts=0,
    hops=0,
    iterations=6,
    ipopt_iterations=0,
)
EXACT = "gfl_pll_filter_exact"


def test_true_values_are_found_again_at_once():
    warm = dict.fromkeys(benchmark().names, TRUE)
    record = ibrid.evaluate(ibrid.textbook(EXACT), benchmark(), settings=LAZY, warm=warm)
    assert record.nrmse is not None
    assert record.nrmse < 1e-9
    assert record.starts["waves"] == 0  # no start of its own was needed


@pytest.mark.slow
@pytest.mark.parametrize("parameters", ["shared", "per-op"])
def test_a_block_more_is_no_worse_than_its_parent(parameters):
    parent = ibrid.evaluate(ibrid.textbook("gfl_exact"), benchmark(), parameters=parameters)
    child = ibrid.evaluate(
        ibrid.textbook(EXACT),
        benchmark(),
        parameters=parameters,
        settings=LAZY,
        warm=parent.parameters,
    )
    assert child.nrmse is not None
    assert parent.nrmse is not None
    # a low-pass far above the PLL's band changes nothing, so the parent's error can be kept but for
    # a few per cent
    assert child.nrmse < 1.05 * parent.nrmse


def test_names_that_a_diagram_lacks_and_points_that_the_data_lack_are_passed_over():
    warm = {"elsewhere": TRUE, **{name: {**TRUE, "ghost.k": 3.0} for name in benchmark().names}}
    record = ibrid.evaluate(ibrid.textbook("gfl_exact"), benchmark(), settings=LAZY, warm=warm)
    assert record.outcome == "ok"


def test_values_outside_their_boxes_are_moved_to_the_edge():
    warm = {name: {**TRUE, "plant.L_F": 50.0} for name in benchmark().names}
    record = ibrid.evaluate(ibrid.textbook(EXACT), benchmark(), settings=LAZY, warm=warm)
    assert all(values["plant.L_F"] <= 1.0 for values in record.parameters.values())


@pytest.mark.slow
def test_a_structure_with_an_entry_that_is_always_zero_is_fitted_too():
    """The logarithmic residual of such an entry has no finite value and no slope."""
    sweep = benchmark()
    points = tuple(
        dataclasses.replace(one, admittance=one.admittance + 0.1 * np.eye(2)[None])
        for one in sweep.points
    )
    diagram = ibrid.parse_program(
        """
def through(g):
    g.add("LFilter", "plant")
    g.add("SliceD", "d")
    g.add("PackDQ", "pack")
    g.add("ConstZero", "zero")
    g.add("Gain_dq", "gain")
    g.connect("v_DQ", "plant.v_in")
    g.connect("v_DQ", "d.in_")
    g.connect("d.out", "pack.in_d")
    g.connect("zero.out", "pack.in_q")
    g.connect("pack.out", "gain.in_")
    g.connect("plant.e", "plant.u_r")
    g.connect("zero.out", "plant.delta_omega")
    g.connect("gain.out", "i_DQ")
"""
    )
    record = ibrid.evaluate(diagram, dataclasses.replace(sweep, points=points))
    assert record.outcome == "ok"
    assert record.nrmse is not None
    assert np.isfinite(record.nrmse)
