"""Rows of sparse regression: a sum of library terms at the terminals, or behind the filter that it
finds first.
"""

from collections.abc import Mapping

import numpy as np
from ibrid_bench.baselines.answer import Answer
from ibrid_bench.baselines.recovered import close
from ibrid_bench.baselines.series_filter import SeriesFilter, series_filter
from ibrid_bench.baselines.sparse_model import SparseModel, sparse_model

from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep


def at_terminals(data: Sweep, wanted: OperatingPoint, frequency: np.ndarray) -> Answer:
    """The library regressed on Y itself."""
    return _answer(
        data,
        sparse_model(data, SeriesFilter()),
        wanted,
        frequency,
        None,
        "a sum of lags and resonances",
    )


def behind_filter(
    data: Sweep, wanted: OperatingPoint, frequency: np.ndarray, truth: Mapping[str, float]
) -> Answer:
    """The grid side of the filter first, by the impedances of the highest frequencies; then the
    library on what lies behind.

    truth : true values, counted but not used.
    """
    filter_ = series_filter(data)
    found = filter_.found
    reader = (
        f"{', '.join(name.split('.')[1] for name in found)}; a sum of lags"
        if found
        else "as above: no filter seen"
    )
    count = sum(name in truth and close(value, truth[name]) for name, value in found.items())
    return _answer(
        data, sparse_model(data, filter_), wanted, frequency, count if found else None, reader
    )


def _answer(
    data: Sweep,
    model: SparseModel,
    wanted: OperatingPoint,
    frequency: np.ndarray,
    recovered: int | None,
    reader: str,
) -> Answer:
    return Answer(
        fitted=[model.admittance(point.op, point.frequency) for point in data.points],
        elsewhere=[model.admittance(wanted, frequency)],
        parameters=model.parameters,
        order="-",
        recovered=recovered,
        reader=reader,
    )
