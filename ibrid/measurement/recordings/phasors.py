"""Recordings of phasors and of rms values as voltage and current, d + j q, in a frame that turns at
the nominal frequency.

Law: a phasor of the positive sequence is d + j q over sqrt 2. With P + j Q = 3 V conj(I) (per unit
V conj(I)), delivered, rms values give I in the frame of the voltage, i_d = P / V, i_q = -Q / V,
which a recorded angle, or a recorded frequency, turns: the angle is the integral of 2 pi (f - f0).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ibrid.errors import SweepError

#: Frame -> its columns, one tuple for each form; beside them may stand those of `BESIDE`.
FORMS = {
    "phasor": (("v_mag", "v_deg", "i_mag", "i_deg"),),
    "rms": (("u", "p", "q"), ("u", "i_p", "i_q")),
}
BESIDE = {"phasor": ("f",), "rms": ("p", "q", "i_p", "i_q", "f", "angle_deg")}
#: Smallest voltage, of the largest, of which a power tells the current; relative difference of two
#: currents that are one.
LEAST, SAME = 1e-3, 0.02
#: Difference from the nominal frequency, Hz, beyond which a column of frequencies is none.
FAR_HZ = 15.0

Waves = tuple[np.ndarray, np.ndarray, tuple[str, ...]]


def waves_of(
    frame: str,
    columns: Mapping[str, np.ndarray],
    header: Mapping[str, Any],
    time: np.ndarray,
    f0_hz: float,
) -> Waves:
    """Voltage of a phase and current (N,), rms, in the units of the file, and remarks.

    header : unit, v_is and phase. Raises SweepError where powers and currents are not those of one
    base, or a frequency is none.
    """
    if frame == "phasor":
        angles = (np.deg2rad(columns[name]) for name in ("v_deg", "i_deg"))
        v, i = (
            columns[size] * np.exp(1j * at)
            for size, at in zip(("v_mag", "i_mag"), angles, strict=True)
        )
        remarks = _one_phase(header)
    else:
        v, i, remarks = _of_rms(columns, header, time, f0_hz)
        remarks = (*_one_phase(header), *remarks)
    si = header.get("unit") == "si"
    if si and header.get("v_is") == "line":
        v = v / np.sqrt(3.0)
        i = i * (1.0 if frame == "phasor" or "i_p" in columns else np.sqrt(3.0))
    return v, i, remarks


def _one_phase(header: Mapping[str, Any]) -> tuple[str, ...]:
    phase = header.get("phase")
    return (
        (f"phase {phase} alone was recorded and stands for the positive sequence",) if phase else ()
    )


def _of_rms(
    columns: Mapping[str, np.ndarray], header: Mapping[str, Any], time: np.ndarray, f0_hz: float
) -> Waves:
    u, three = columns["u"], 3.0 if header.get("unit") == "si" else 1.0
    by_power = (
        None if "p" not in columns else current_of_powers(columns["p"], columns["q"], u) / three
    )
    by_current = None if "i_p" not in columns else columns["i_p"] - 1j * columns["i_q"]
    if by_power is not None and by_current is not None:
        _require_one_base(by_power, by_current, header)
    current = by_power if by_current is None else by_current
    angle, remarks = _angle(columns, time, f0_hz)
    turn = np.exp(1j * angle)
    return u * turn, np.asarray(current) * turn, remarks


def current_of_powers(p: np.ndarray, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Current (N,), d + j q in the frame of the voltage, (p - j q) / u; of a u below `LEAST` of the
    largest as of that.
    """
    return (p - 1j * q) / np.maximum(u, LEAST * float(u.max(initial=0.0)) or 1.0)


def angle_of_frequency(away: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Angle (N,), rad, from 0 on, of a voltage whose frequency departs from the nominal one by
    `away`, Hz.
    """
    return (
        2.0
        * np.pi
        * np.concatenate([[0.0], np.cumsum(0.5 * (away[1:] + away[:-1]) * np.diff(time))])
    )


def _require_one_base(
    by_power: np.ndarray, by_current: np.ndarray, header: Mapping[str, Any]
) -> None:
    """SweepError where P, Q and U tell another current than the columns of the current."""
    if header.get("unit") == "si" and header.get("v_is") == "line":
        by_power = by_power * np.sqrt(3.0)
    factor = float(np.linalg.norm(by_power) / max(float(np.linalg.norm(by_current)), 1e-12))
    apart = float(
        np.linalg.norm(by_power - by_current) / max(float(np.linalg.norm(by_current)), 1e-12)
    )
    if apart > SAME:
        raise SweepError(
            f"p and q over u must be i_p and i_q; found {factor:.4g} times as much: they are of "
            "another base, or of another "
            "sign or place, correct one or leave one pair out."
        )


def _angle(
    columns: Mapping[str, np.ndarray], time: np.ndarray, f0_hz: float
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Angle of the voltage, rad, (N,), and what is not known of it."""
    if "angle_deg" in columns:
        return np.deg2rad(columns["angle_deg"]), ()
    if "f" not in columns:
        words = (
            "no angle and no frequency were recorded: the voltage is taken to turn at the nominal "
            "frequency all along"
        )
        return np.zeros(len(time)), (words,)
    away = columns["f"] - f0_hz
    if np.abs(away).max(initial=0.0) > FAR_HZ:
        at = int(np.argmax(np.abs(away)))
        raise SweepError(
            f"the frequency f must be within {FAR_HZ:g} Hz of f0_hz = {f0_hz:g}; found "
            f"{columns['f'][at]:g} at {time[at]:g} s, "
            "correct the cell, its unit (Hz) or f0_hz."
        )
    return angle_of_frequency(away, time), (
        "the angle of the voltage is the integral of its frequency",
    )
