"""What a method gives, and its errors by data and truth: one row of the table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.evaluation.errors_by_part import nrmse
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Answer:
    """A fitted model, as far as the table wants it.

    fitted : (K, 2, 2) at each operating point of the data. elsewhere : at the held-out one; several
    where the method has several
    equally good answers. parameters : numbers in the model. order : poles or states at one
    operating point, in words.
    recovered : true parameters within 5 %; None for a method that has no physical parameters.
    reader : what a reader gets.
    seconds : None: as measured around the method.
    """

    fitted: Sequence[np.ndarray]
    elsewhere: Sequence[np.ndarray]
    parameters: int
    order: str
    recovered: int | None
    reader: str
    seconds: float | None = None


def scored(answer: Answer, data: Sweep, truth: Sweep, held_out: PointSweep) -> Row:
    """Mean NRMSE over operating points. `fitted` : against the data, `true` : against the truth at
    the same points,
    `held_out` : against the truth at the held-out point.
    """

    def mean(responses: Sequence[np.ndarray], points: Sequence[PointSweep]) -> float:
        return float(
            np.mean([nrmse(one, point) for one, point in zip(responses, points, strict=True)])
        )

    return {
        "fitted": mean(answer.fitted, data.points),
        "true": mean(answer.fitted, truth.points),
        "held_out": mean(answer.elsewhere, [held_out] * len(answer.elsewhere)),
        "parameters": answer.parameters,
        "order": answer.order,
        "recovered": answer.recovered,
        "reader": answer.reader,
    }
