"""The inputs of the fits by other libraries: scikit-rf's vector fit, which finds no structure, and
scipy's least squares on the same structure.
"""

import time
import warnings

import numpy as np
import skrf
from ibrid_bench.fit.speed import reference_seconds
from ibrid_bench.real_sizes.jobs import Fit
from skrf.vectorFitting import VectorFitting

import ibrid
from ibrid.measurement.sweeps.sweep import PointSweep

#: Starts of scipy's least squares, of which the best counts.
STARTS = 6


def vector_fit_row(fit: Fit) -> str:
    """Processor seconds and error of scikit-rf, all operating points one after the other, at the
    order of the true structure.
    """
    sweep = fit.measured.sweep()
    order = ibrid.evaluate(_diagram(fit), sweep).order
    before = time.process_time()
    errors = [_vector_fit_error(point, order) for point in sweep.points]
    seconds = time.process_time() - before
    return f"{seconds:6.2f} s   scikit-rf, order {order}: NRMSE {np.mean(errors):.2e}"


def least_squares_row(fit: Fit) -> str:
    """Seconds and error of scipy's least squares on compiled matrices."""
    seconds, error, responses = reference_seconds(
        _diagram(fit), fit.measured.sweep(), starts=STARTS, by_interconnect=False
    )
    return f"{seconds:6.2f} s   scipy, {STARTS} starts, {responses} responses: NRMSE {error:.2e}"


def _diagram(fit: Fit) -> ibrid.Diagram:
    return ibrid.textbook(fit.diagram or fit.measured.plant)


def _vector_fit_error(point: PointSweep, order: int) -> float:
    network = skrf.Network(frequency=skrf.Frequency.from_f(point.frequency, unit="Hz"))
    network.y = point.admittance
    fitting = VectorFitting(network)
    real = order % 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitting.vector_fit(n_poles_real=real, n_poles_cmplx=(order - real) // 2, parameter_type="y")
    model = np.array(
        [[fitting.get_model_response(i, j, point.frequency) for j in (0, 1)] for i in (0, 1)]
    ).transpose(2, 0, 1)
    error = np.linalg.norm(model - point.admittance)
    return float(error / np.linalg.norm(point.admittance))
