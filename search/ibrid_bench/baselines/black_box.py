"""Rows of vector fitting: one rational model for each operating point, carried to the held-out one
in three ways.
"""

from collections.abc import Sequence

import numpy as np
from ibrid_bench.baselines.answer import Answer
from ibrid_bench.baselines.between import nearest, weights_between
from ibrid_bench.baselines.vector_fit import RationalModel, vector_fit

from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep

READER = "poles and residues"


def nearest_point(data: Sweep, wanted: OperatingPoint, frequency: np.ndarray) -> Answer:
    """Elsewhere: the model of the nearest measured operating point; each of them where several are
    equally near.
    """
    models = [vector_fit(point) for point in data.points]
    places = nearest([point.op for point in data.points], wanted)
    return _answer(data, models, [models[place].admittance(frequency) for place in places])


def between_points(data: Sweep, wanted: OperatingPoint, frequency: np.ndarray) -> Answer:
    """Elsewhere: the polynomial in p and q through the responses of all models."""
    models = [vector_fit(point) for point in data.points]
    weights = weights_between([point.op for point in data.points], wanted)
    whole = sum(
        weight * model.admittance(frequency) for weight, model in zip(weights, models, strict=True)
    )
    return _answer(data, models, [np.asarray(whole)])


def _answer(
    data: Sweep, models: Sequence[RationalModel], elsewhere: Sequence[np.ndarray]
) -> Answer:
    orders = sorted({model.order for model in models})
    return Answer(
        fitted=[
            model.admittance(point.frequency)
            for model, point in zip(models, data.points, strict=True)
        ],
        elsewhere=elsewhere,
        parameters=sum(model.parameters for model in models),
        order=f"{orders[0]}" if len(orders) == 1 else f"{orders[0]} to {orders[-1]}",
        recovered=None,
        reader=READER,
    )
