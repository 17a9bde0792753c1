"""Residuals and what is drawn together: white noise stays within its bounds, structure does not."""

import numpy as np
import pytest

import ibrid
from ibrid.errors import IbridError
from ibrid.report.figures.displayed_figure import DisplayedFigure

FREQUENCIES = np.geomspace(5.0, 5000.0, 60)


@pytest.fixture(scope="module")
def noisy() -> ibrid.Sweep:
    return ibrid.sweep("gfl_l_filter", None, FREQUENCIES, noise_db=46.0, seed=2)


@pytest.fixture(scope="module")
def right(noisy: ibrid.Sweep) -> ibrid.Record:
    return ibrid.evaluate("gfl_l_filter", noisy)


def test_what_a_right_model_leaves_is_white_noise_of_size_one(right, noisy):
    left = ibrid.residuals(right, noisy)
    assert left.rms == pytest.approx(1.0, abs=0.1)
    assert left.outside < 0.12  # 5 % of 60 numbers are expected: 3, at most 7
    np.testing.assert_allclose(left.autocorrelation[0], 1.0)
    np.testing.assert_allclose(np.diag(left.cross_correlation), 1.0)
    beside = left.cross_correlation - np.eye(4)
    assert np.abs(beside).max() < 2 * left.bound


def test_what_a_wrong_model_leaves_is_correlated_along_the_frequencies(noisy):
    wrong = ibrid.evaluate("naive", noisy, restarts=0)
    left = ibrid.residuals(wrong, noisy)
    assert left.rms > 20
    assert left.outside > 0.3
    assert (left.autocorrelation[1] > 3 * left.bound).all()


def test_residuals_are_a_table_a_picture_and_a_line(right, noisy):
    left = ibrid.residuals(right, noisy)
    assert isinstance(left.plot(), DisplayedFigure)
    assert len(left.plot().axes) == 3
    assert "95 % bound of white noise" in repr(left)
    pytest.importorskip("pandas", reason="tables need pandas; pip install 'ibrid[tables]'")
    assert len(left.to_dataframe()) == 2 * 60 * 4


def test_sweeps_records_and_predictions_are_drawn_together(right, noisy):
    predicted = ibrid.predict(right, "p=0.5,q=0", np.geomspace(5, 5000, 30))
    figure = ibrid.plot(noisy, right, predicted, "paper_like")
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert len(names) == 2 + 2 + 1 + 2
    assert sum(name.startswith("gfl_l_filter, ") for name in names) >= 2
    assert names[4] == "predicted, p=0.5,q=0"
    with pytest.raises(IbridError, match="plot draws sweeps, records and predictions"):
        ibrid.plot(3)


def test_a_fitted_curve_has_its_band(right):
    plain, banded = right.plot(), right.plot(band=True)
    shaded = [sum(len(axes.collections) for axes in one.axes) for one in (plain, banded)]
    assert shaded[1] > shaded[0]
