"""Sweeps from python-control: a FrequencyResponseData object, or plain arrays of frequencies and matrices."""

from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conversions import Quantity
from ibrid.measurement.header import known_keys
from ibrid.measurement.response import sweep_of_response
from ibrid.measurement.sweep import Sweep


def from_frd(frd: Any, *, p: float, q: float, v: float = 1.0, f0_hz: float = 60.0, **keys: object) -> Sweep:
    """A sweep of one operating point from a python-control FRD with two inputs and two outputs.

    frd : control.FrequencyResponseData; omega in rad/s, response (2, 2, K) from [v_D, v_Q] to [i_D, i_Q].
    p, q, v : steady state, per unit, delivered.
    keys : op (a name), unit, current, q_axis, power_node, s_base_va, v_base_v, sampling_hz, as in a sweep file.

    Raises SweepError when the object is not a 2x2 frequency response.
    """
    response = getattr(frd, "frdata", None)
    omega = getattr(frd, "omega", None)
    if response is None or omega is None:
        raise SweepError(f"from_frd must get a python-control FRD; found {type(frd).__name__}, try from_responses.")
    response = np.asarray(response)
    if response.ndim != 3 or response.shape[:2] != (2, 2):
        raise SweepError(
            f"the FRD must have two inputs and two outputs; found shape {response.shape}, "
            "put v_D, v_Q in and i_D, i_Q out."
        )
    name = str(getattr(frd, "name", "") or "frd")
    frequency = np.asarray(omega, float) / (2 * np.pi)
    given = known_keys({"p": p, "q": q, "v": v, "f0_hz": f0_hz, **keys})
    return sweep_of_response(frequency, np.moveaxis(response, -1, 0), given, where=f"frd {name}")


def from_responses(
    frequency: np.ndarray, response: np.ndarray, *, p: float, q: float, impedance: bool = False, **keys: object
) -> Sweep:
    """A sweep of one operating point from arrays.

    frequency : (K,) Hz.
    response : complex, (K, 2, 2) or (2, 2, K); admittance, or impedance if `impedance`.
    keys : op, v, f0_hz, unit, current, q_axis, power_node, s_base_va, v_base_v, sampling_hz, as in a sweep file.

    Raises SweepError when the shapes do not fit together.
    """
    given = known_keys({"p": p, "q": q, **keys})
    frequency = np.atleast_1d(np.asarray(frequency, float))
    matrix = stacked(np.asarray(response, complex), len(frequency), "the response")
    return sweep_of_response(frequency, matrix, given, where="responses", quantity=Quantity("Z" if impedance else "Y"))


def stacked(response: np.ndarray, count: int, what: str, *, frequency_last: bool = False) -> np.ndarray:
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
        f"{what} must have shape (2, 2, {count}) or ({count}, 2, 2), one matrix per frequency; found {response.shape}."
    )
