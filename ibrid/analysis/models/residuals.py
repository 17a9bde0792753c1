"""Residuals of a fit, and whether they are white: what a right model leaves is noise alone.

Reference: L. Ljung, System Identification, 1999, section 16.6 (residual analysis).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.grade import judged_points
from ibrid.evaluation.record import Record
from ibrid.foreign_text import place_shown
from ibrid.frozen import Frozen
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import ENTRIES, Sweep
from ibrid.showing import brief, made_above, shown

#: Neighbours over which correlation is shown, as many as a fourth of the frequencies allow.
MOST_LAGS = 20
#: Quantile of a normal distribution, 95 %.
NORMAL_95 = 1.96


@dataclass(frozen=True, eq=False)
class Residuals(Frozen):
    """Standardised residuals of a record, (measured - model) / sigma.

    frequency : operating point -> (K,) Hz. values : operating point -> (K, 4, 2), of the entries
    dd, dq, qd, qq the real and the imaginary part, 1 being one standard deviation of the noise.
    autocorrelation : (L + 1, 4) of an entry with itself, L frequencies further, 1 at 0.
    cross_correlation : (4, 4) of the entries at the same frequency. bound : what 95 % of the
    autocorrelations of white noise stay below. noise : where sigma comes from; where it is
    "unknown", 1e-4 of |Y| is taken.
    """

    frequency: Mapping[str, np.ndarray]
    values: Mapping[str, np.ndarray]
    autocorrelation: np.ndarray
    cross_correlation: np.ndarray
    bound: float
    noise: str

    @property
    def outside(self) -> float:
        """Share of the autocorrelations beyond their bound; 0.05 where the residuals are white."""
        return float((np.abs(self.autocorrelation[1:]) > self.bound).mean())

    @property
    def rms(self) -> float:
        """Root mean square of all residuals; 1 where they are the noise."""
        return float(np.sqrt(np.mean(np.concatenate(list(self.values.values())) ** 2)))

    def plot(self) -> Any:
        """A matplotlib figure: residuals over frequency, their correlation along the frequencies
        with the 95 % bound of white noise, and that between the entries.
        """
        return shown(self, "plotting", "residuals_plot")

    def _repr_html_(self) -> str:
        """Residuals over frequency, for notebooks."""
        return shown(self, "pages.notebook", "residuals_html")

    def to_dataframe(self) -> Any:
        """A pandas DataFrame: op, freq_hz, entry, real, imaginary."""
        rows = [
            {"op": op, "freq_hz": hz, "entry": entry, "real": pair[0], "imaginary": pair[1]}
            for op, values in self.values.items()
            for hz, row in zip(self.frequency[op].tolist(), values.tolist(), strict=True)
            for entry, pair in zip(ENTRIES, row, strict=True)
        ]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def __repr__(self) -> str:
        return brief(
            f"<Residuals: rms {self.rms:.3g} sigma, {self.outside:.0%} of the autocorrelations "
            "beyond the 95 % bound of white noise",
            ">",
        )


@takes_kinds
def residuals(record: Record, sweep: Sweep | None = None) -> Residuals:
    """Compute the standardised residuals of a fit and their correlations.

    Parameters
    ----------
    record : with a fit.
    sweep : the data that it was fitted to; read again from where the record says when not given.

    Raises IbridError where the data are not there or lack the fitted operating points.
    """
    if sweep is None:
        place = place_shown(str(record.settings.get("data") or ""))
        if not place:
            raise IbridError("the record does not say where its data are; give the sweep")
        sweep = read_sweep(place)
    judged, noise = judged_points([sweep.point(name) for name in record.nrmse_by_op])
    frequency = {point.op.name: point.frequency for point in judged}
    values = {}
    for point in judged:
        difference = point.admittance - record.response(point.op.name, point.frequency)
        standardised = difference / np.asarray(point.sigma)
        parts = np.stack([standardised.real, standardised.imag], axis=-1)
        values[point.op.name] = parts.reshape(-1, len(ENTRIES), 2)
    lags = min(MOST_LAGS, min(map(len, values.values())) // 4)
    if lags < 1:
        raise IbridError("residuals need at least four frequencies at each operating point")
    products = [_lagged_products(list(values.values()), lag) for lag in range(lags + 1)]
    power = np.maximum(products[0][0], np.finfo(float).tiny)
    count = products[0][1]
    whole = np.concatenate([value.transpose(0, 2, 1).reshape(-1, 4) for value in values.values()])
    scale = np.sqrt(np.maximum((whole**2).mean(axis=0), np.finfo(float).tiny))
    return Residuals(
        frequency=frequency,
        values=values,
        autocorrelation=np.array([mean / power for mean, _ in products]),
        cross_correlation=(whole.T @ whole) / len(whole) / np.outer(scale, scale),
        bound=NORMAL_95 / np.sqrt(count),
        noise=noise,
    )


def _lagged_products(values: list[np.ndarray], lag: int) -> tuple[np.ndarray, int]:
    """Mean of the products of residuals `lag` frequencies apart, (4,), of both parts and all
    operating points; and how many they are.
    """
    products = [
        (value[: len(value) - lag] * value[lag:]).transpose(0, 2, 1).reshape(-1, 4)
        for value in values
    ]
    joined = np.concatenate(products)
    return joined.mean(axis=0), len(joined)
