"""Sweeps from python-control: a FrequencyResponseData object or a model, or plain arrays of
frequencies and matrices.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError
from ibrid.measurement.conventions.conversions import Quantity
from ibrid.measurement.conventions.header import known_keys
from ibrid.measurement.formats.response import sweep_of_response
from ibrid.measurement.formats.response_labels import require_d_first
from ibrid.measurement.sweeps.masked import require_unmasked
from ibrid.measurement.sweeps.sweep import Sweep


@takes_kinds
def from_frd(
    frd: Any, *, p: float, q: float, v: float = 1.0, f0_hz: float = 60.0, **keys: object
) -> Sweep:
    """A sweep of one operating point from a python-control FRD with two inputs and two outputs.

    frd : control.FrequencyResponseData; omega in rad/s, response (2, 2, K) from [v_D, v_Q] to [i_D,
    i_Q].
    p, q, v : steady state, per unit, delivered.
    keys : op (a name), unit, current, q_axis, power_node, s_base_va, v_base_v, sampling_hz, as in a
    sweep file.

    Raises SweepError when the object is not a 2x2 frequency response.
    """
    response = getattr(frd, "frdata", None)
    omega = getattr(frd, "omega", None)
    if response is None or omega is None:
        raise SweepError(
            f"from_frd must get a python-control FRD; found {type(frd).__name__}, try from_system "
            "for a model and "
            "from_responses for arrays."
        )
    require_unmasked("the frequencies of the FRD", omega)
    require_unmasked("the response of the FRD", response)
    response = np.asarray(response)
    if response.ndim != 3 or response.shape[:2] != (2, 2):
        raise SweepError(
            f"the FRD must have two inputs and two outputs; found shape {response.shape}, "
            "put v_D, v_Q in and i_D, i_Q out."
        )
    _require_d_first(frd, "the FRD")
    name = str(getattr(frd, "name", "") or "frd")
    frequency = np.asarray(omega, float) / (2 * np.pi)
    given = known_keys({"p": p, "q": q, "v": v, "f0_hz": f0_hz, **keys})
    return sweep_of_response(frequency, np.moveaxis(response, -1, 0), given, where=f"frd {name}")


#: (60,) Hz, 5 Hz to 5 kHz, where a model is read as a sweep and nothing else is asked for.
MODEL_GRID = np.array([float(f"{hz:.12g}") for hz in np.geomspace(5.0, 5000.0, 60)])


@takes_kinds
def from_system(
    system: Any,
    frequency: np.ndarray | Sequence[float] | None = None,
    *,
    p: float,
    q: float,
    v: float = 1.0,
    **keys: Any,
) -> Sweep:
    """A sweep of one operating point from a python-control model, as if it had been measured
    without noise.

    system : control.StateSpace or TransferFunction, continuous or sampled, from [v_D, v_Q] to [i_D,
    i_Q]; an FRD keeps
        its own frequencies. frequency : (K,) Hz, by default `MODEL_GRID`.
    p, q, v, keys : as in `from_frd`.

    Raises SweepError when the object is no such model, or has no finite response at a frequency.
    """
    if hasattr(system, "frdata"):
        if frequency is not None:
            raise SweepError(
                "an FRD is given at its own frequencies; leave frequency out, or choose among its "
                "rows."
            )
        return from_frd(system, p=p, q=q, v=v, **keys)
    if not callable(getattr(system, "frequency_response", None)):
        raise SweepError(
            f"from_system must get a python-control model; found {type(system).__name__}."
        )
    if (getattr(system, "noutputs", None), getattr(system, "ninputs", None)) != (2, 2):
        raise SweepError(
            "the model must have two inputs and two outputs; found "
            f"{getattr(system, 'ninputs', None)} and "
            f"{getattr(system, 'noutputs', None)}, put v_D, v_Q in and i_D, i_Q out."
        )
    _require_d_first(system, "the model")
    require_unmasked("frequencies", frequency)
    grid = np.atleast_1d(np.asarray(MODEL_GRID if frequency is None else frequency, float))
    with np.errstate(all="ignore"):
        response = system(_laplace_or_z(system, grid), squeeze=False, warn_infinite=False)
    given = known_keys({"p": p, "q": q, "v": v, **keys})
    name = str(getattr(system, "name", "") or "model")
    return sweep_of_response(
        grid, np.moveaxis(np.asarray(response), -1, 0), given, where=f"model {name}"
    )


def _require_d_first(system: Any, what: str) -> None:
    """Raise SweepError where the labels of inputs or outputs say that q comes before d."""
    for side in ("input_labels", "output_labels"):
        require_d_first([*(getattr(system, side, None) or ())], f"{side} of {what}")


def _laplace_or_z(system: Any, frequency: np.ndarray) -> np.ndarray:
    """j omega of a continuous model, exp(j omega T) of a sampled one, which says nothing above half
    its rate.
    """
    period, omega = getattr(system, "dt", None), 2 * np.pi * frequency
    if period is True:
        raise SweepError(
            "a sampled model must know its sampling period; found dt = True, give it in seconds."
        )
    if not period:
        return 1j * omega
    if frequency.max() * period > 0.5:
        raise SweepError(
            f"the model is sampled at {1 / period:g} Hz, so frequencies must be at most half of "
            "that; found "
            f"{frequency.max():g} Hz, give frequency."
        )
    return np.exp(1j * omega * period)


@takes_kinds
def from_responses(
    frequency: np.ndarray,
    response: np.ndarray,
    *,
    p: float,
    q: float,
    impedance: bool = False,
    **keys: object,
) -> Sweep:
    """A sweep of one operating point from arrays.

    frequency : (K,) Hz.
    response : complex, (K, 2, 2) or (2, 2, K); admittance, or impedance if `impedance`.
    keys : op, v, f0_hz, unit, current, q_axis, power_node, s_base_va, v_base_v, sampling_hz, as in
    a sweep file.

    Raises SweepError when the shapes do not fit together.
    """
    given = known_keys({"p": p, "q": q, **keys})
    require_unmasked("frequencies", frequency)
    require_unmasked("the response", response)
    if np.iscomplexobj(frequency):
        raise SweepError(
            "frequencies must be real numbers; found complex ones, give their real part if it is "
            "meant."
        )
    frequency = np.atleast_1d(np.asarray(frequency, float))
    matrix = stacked(np.asarray(response, complex), len(frequency), "the response")
    return sweep_of_response(
        frequency, matrix, given, where="responses", quantity=Quantity("Z" if impedance else "Y")
    )


def stacked(
    response: np.ndarray, count: int, what: str, *, frequency_last: bool = False
) -> np.ndarray:
    """(K, 2, 2) from (K, 2, 2) or, as MATLAB and python-control keep it, (2, 2, K).

    frequency_last : which of the two is meant when K = 2.

    Raises SweepError, beginning with `what`, when neither fits.
    """
    if count == 1 and response.shape == (2, 2):
        return response[None]
    last = response.shape == (2, 2, count)
    first = response.shape == (count, 2, 2)
    if last and (frequency_last or not first):
        return np.moveaxis(response, -1, 0)
    if first:
        return response
    raise SweepError(
        f"{what} must have shape (2, 2, {count}) or ({count}, 2, 2), one matrix per frequency; "
        f"found {response.shape}."
    )
