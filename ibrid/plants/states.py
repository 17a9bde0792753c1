"""Building blocks of nonlinear equations in CasADi: vectors in a rotating frame and a list of states with their rates."""

from types import SimpleNamespace

import casadi as ca

#: Field of Device -> symbol, None where the parameter is not there, the word where it is a switch.
Symbols = SimpleNamespace


def J(z: ca.SX) -> ca.SX:
    """Turned by 90 degrees, towards q."""
    return ca.vertcat(-z[1], z[0])


def R(delta: ca.SX) -> ca.SX:
    """(2, 2): from the grid frame to a frame that leads it by delta."""
    c, s = ca.cos(delta), ca.sin(delta)
    return ca.vertcat(ca.horzcat(c, s), ca.horzcat(-s, c))


class States:
    """Symbols of the states and, once known, their rates of change per second."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._symbols: list[ca.SX] = []
        self._rates: list[ca.SX] = []

    def add(self, name: str, size: int = 1) -> ca.SX:
        """A new state of one or two components."""
        self.names += [name] if size == 1 else [f"{name}_d", f"{name}_q"]
        self._symbols.append(ca.SX.sym(name, size))
        self._rates.append(ca.SX.nan(size))
        return self._symbols[-1]

    def moves(self, state: ca.SX, rate: ca.SX) -> None:
        """Set the rate of change of a state."""
        index = next(k for k, symbol in enumerate(self._symbols) if symbol is state)
        self._rates[index] = rate

    @property
    def x(self) -> ca.SX:
        """All states, (n,)."""
        return ca.vertcat(*self._symbols)

    @property
    def x_dot(self) -> ca.SX:
        """Their rates, (n,)."""
        return ca.vertcat(*self._rates)


def low_pass(states: States, name: str, omega_c: ca.SX | float | None, signal: ca.SX) -> ca.SX:
    """omega_c / (s + omega_c) of each component of a signal; the signal itself without a corner."""
    if omega_c is None:
        return signal
    filtered = states.add(name, signal.numel())
    states.moves(filtered, omega_c * (signal - filtered))
    return filtered


def notch(states: States, name: str, omega_n: ca.SX | None, Q: ca.SX | None, signal: ca.SX) -> ca.SX:
    """(s^2 + omega_n^2) / (s^2 + omega_n/Q s + omega_n^2) of each component; the signal itself without a frequency."""
    if omega_n is None or Q is None:
        return signal
    return signal - band_pass(states, name, omega_n, omega_n / Q, signal)


def band_pass(states: States, name: str, omega_n: ca.SX, width: ca.SX, signal: ca.SX) -> ca.SX:
    """width s / (s^2 + width s + omega_n^2) of each component."""
    band, quadrature = (states.add(f"{name}_{part}", signal.numel()) for part in ("band", "quadrature"))
    states.moves(band, width * (signal - band) - omega_n * quadrature)
    states.moves(quadrature, omega_n * band)
    return band
