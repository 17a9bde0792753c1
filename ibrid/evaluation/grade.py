"""How far a model explains its data: what is left over against the noise, as chi-square and as one
of four words.

With residuals r of n real numbers whose noise has the deviation sigma, sum (r / sigma)^2 follows
chi2 with n minus the free numbers as degrees of freedom when noise alone is left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from itertools import product
from typing import Any

import numpy as np

from ibrid.evaluation.errors_by_part import noise_floor
from ibrid.fit.adequacy import is_adequate
from ibrid.fit.identifiability import MODEL_FLOOR
from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, measured_numbers
from ibrid.writing import PlainData

#: Multiple of the noise up to which what is left over is close.
CLOSE = 2.0
#: Largest NRMSE of a rough model.
ROUGH = 0.1
#: Relative to |Y|_F: what data of unknown noise are taken to have.
LEAST_UNKNOWN = 1e-4
#: Least significance of a part that is told.
LEAST_Z = 3.0


class Grade(StrEnum):
    """`explains`: what is left is noise. `close`: at most `CLOSE` noise floors beside it. `rough`:
    NRMSE to `ROUGH`. `fails`.
    """

    EXPLAINS = "explains"
    CLOSE = "close"
    ROUGH = "rough"
    FAILS = "fails"


def misfit_of(
    responses: Sequence[np.ndarray], points: Sequence[PointSweep], free: int
) -> PlainData:
    """The record's `misfit`: chi2 per degree of freedom, the noise floor as an NRMSE and where it
    is from, and the parts by operating point, entry and band that stand out of the noise, the worst
    first.

    responses : (K, 2, 2) of the model, one per point. free : numbers that were fitted. chi2_per_dof
    is None where as many numbers were fitted as measured.
    """
    numbers = measured_numbers(points)
    dof = numbers - free
    judged, source = judged_points(points)
    parts: list[PlainData] = []
    chi2 = 0.0
    for response, point in zip(responses, judged, strict=True):
        square = np.abs((response - point.admittance) / point.sigma) ** 2
        chi2 += float(square.sum())
        bands = band_index(point.frequency)
        for (index, band), (entry, (i, j)) in product(enumerate(BAND_NAMES), ENTRIES.items()):
            part = square[bands == index, i, j]
            z = (
                normal_score(float(part.sum()) * numbers / max(dof, 1), 2 * part.size)
                if part.size
                else 0.0
            )
            if z > LEAST_Z:
                parts.append({"op": point.op.name, "entry": entry, "band": band, "z": z})
    return {
        "chi2_per_dof": chi2 / dof if dof > 0 else None,
        "dof": dof,
        "floor": {"value": noise_floor(judged), "from": source},
        "by_entry_band": sorted(parts, key=lambda one: -one["z"]),
    }


def judged_points(points: Sequence[PointSweep]) -> tuple[list[PointSweep], str]:
    """The points with the deviation that they are judged by, and where it is from."""
    noise = [estimate_point(point) for point in points]
    source = next((one.source for one in noise if one.sigma is None), noise[0].source)
    judged = []
    for point, known in zip(points, noise, strict=True):
        least = LEAST_UNKNOWN if source == "unknown" else MODEL_FLOOR
        least = np.linalg.norm(point.admittance, axis=(1, 2))[:, None, None] * np.full(
            (2, 2), least / np.sqrt(8.0)
        )
        sigma = least if source == "unknown" else np.hypot(np.asarray(known.sigma), least)
        judged.append(replace(point, sigma=sigma, repeats=None))
    return judged, source


def grade_of(nrmse: float, misfit: Mapping[str, Any]) -> Grade:
    """The word for an NRMSE and a misfit; without degrees of freedom a good fit says nothing, so it
    is rough at best.
    """
    ratio, dof = misfit["chi2_per_dof"], misfit["dof"]
    if ratio is not None and is_adequate(ratio * dof, dof):
        return Grade.EXPLAINS
    if ratio is not None and ratio <= 1.0 + CLOSE**2:
        return Grade.CLOSE
    return Grade.ROUGH if nrmse <= ROUGH else Grade.FAILS


def normal_score(square: float, dof: float) -> float:
    """A chi2 value as that many standard deviations of a normal distribution (Wilson and
    Hilferty).
    """
    return float(
        ((square / dof) ** (1.0 / 3.0) - (1.0 - 2.0 / (9.0 * dof))) / np.sqrt(2.0 / (9.0 * dof))
    )
