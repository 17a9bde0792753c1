"""Blocks that hidden devices alone are made of, and the symbols of their parameters."""

from types import SimpleNamespace

import casadi as ca

from ibrid.plants.dynamics import States

#: Field of Device -> symbol, None where the parameter is not there, the word where it is a switch.
Symbols = SimpleNamespace


def notch(
    states: States, name: str, omega_n: ca.SX | None, Q: ca.SX | None, signal: ca.SX
) -> ca.SX:
    """(s^2 + omega_n^2) / (s^2 + omega_n/Q s + omega_n^2) of each component; the signal itself
    without a frequency.
    """
    if omega_n is None or Q is None:
        return signal
    return signal - band_pass(states, name, omega_n, omega_n / Q, signal)


def band_pass(states: States, name: str, omega_n: ca.SX, width: ca.SX, signal: ca.SX) -> ca.SX:
    """width s / (s^2 + width s + omega_n^2) of each component."""
    band, quadrature = (
        states.add(f"{name}_{part}", signal.numel()) for part in ("band", "quadrature")
    )
    states.moves(band, width * (signal - band) - omega_n * quadrature)
    states.moves(quadrature, omega_n * band)
    return band
