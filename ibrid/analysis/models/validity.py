"""How far an answer of a model holds: a bad fit, an unstable model, points and frequencies that
were not measured.
"""

from collections.abc import Iterator

import numpy as np

from ibrid.analysis.models.linear_model import LinearModel
from ibrid.analysis.models.modes import STABLE_BELOW, rightmost
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.quantities import hertz
from ibrid.measurement.sweeps.sweep import OperatingPoint

#: NRMSE from which on a model misses its measurement where its noise is not known, and the multiple
#: of the noise up to which it does not.
BAD_FIT, NOISE = 0.1, 1.5
#: Part by which a frequency may pass the last measured one.
ROUNDING = 1e-6


def beyond_points(record: Record, op: OperatingPoint) -> Iterator[str]:
    """A sentence when p, q or v of `op` lies outside the range of the fitted operating points."""
    points = record.settings["operating_points"]
    seen = [points[name] for name in record.settings.get("fitted_points", points)]
    beyond = []
    for key in "pqv":
        low, high = min(float(one[key]) for one in seen), max(float(one[key]) for one in seen)
        value = getattr(op, key)
        if not low - 1e-9 <= value <= high + 1e-9:
            measured = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            beyond.append(f"{key} = {value:g} (measured {measured})")
    if beyond:
        yield (
            f"{op.name} lies outside the measured range in {' and '.join(beyond)}: the answer "
            "assumes that the diagram holds "
            "there too"
        )


def beyond_frequencies(record: Record, frequency: np.ndarray) -> Iterator[str]:
    """A sentence when frequencies (K,), Hz, ascending, pass the measured range."""
    low, high = measured_frequencies(record)
    if frequency[0] < low * (1 - ROUNDING) or frequency[-1] > high * (1 + ROUNDING):
        yield (
            f"frequencies from {frequency[0]:g} to {frequency[-1]:g} Hz were asked, {low:g} to "
            f"{high:g} Hz measured: what "
            "acts only beyond cannot be known"
        )


def bad_fit(record: Record) -> Iterator[str]:
    """A sentence when the model misses the measurement that it was fitted to."""
    error, over = record.nrmse or 0.0, record.over_noise or 0.0
    if over > NOISE or error > max(BAD_FIT, NOISE * (record.noise_floor or 0.0)):
        noise = f", {over:.2g} times the noise" if over > NOISE else ""
        yield (
            f"the model misses its own measurement (NRMSE {error:.2g}{noise}): something is "
            "missing in the diagram, which no "
            "band holds"
        )


def unstable(model: LinearModel) -> Iterator[str]:
    """A sentence when the model has an unstable pole on an ideal grid."""
    worst = rightmost(model.A)
    if worst.real >= STABLE_BELOW:
        yield (
            f"the model is unstable at {model.op} on an ideal grid (a pole at {worst.real:+.3g} "
            "rad/s, "
            f"{hertz(worst.imag / (2 * np.pi))}): this admittance is a formal transfer function "
            "that no measurement on a "
            "stiff grid would show; ibrid stability tells which grids make it stable"
        )


def doubts(
    record: Record, model: LinearModel, frequency: np.ndarray | None = None
) -> Iterator[str]:
    """All of these sentences for a model of the record, and the frequencies (K,), Hz, at which it
    is asked.
    """
    yield from unstable(model)
    yield from bad_fit(record)
    yield from beyond_points(record, OperatingPoint(model.op, model.p, model.q, model.v))
    if frequency is not None:
        yield from beyond_frequencies(record, frequency)


def measured_frequencies(record: Record) -> tuple[float, float]:
    """Lowest and highest measured frequency, Hz."""
    low, high = record.settings["frequency_hz"]
    return float(low), float(high)
