"""A nonlinear state-space model of a reference inverter in CasADi: building blocks, and what makes
it rest where it should.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca


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


def pi_control(states: States, name: str, kP: float, kI: float, error: ca.SX) -> ca.SX:
    """(kP + kI/s) of each component of an error."""
    integral = states.add(name, error.numel())
    states.moves(integral, error)
    return kP * error + kI * integral


@dataclass(frozen=True)
class Dynamics:
    """x' = f(x, v_DQ, r), i_DQ = g(x, v_DQ) as CasADi functions; r (m,) are set-points, constant in
    a sweep.

    states : names, one per entry of x, in the naming of the block diagrams where such a state
    exists.
    f : (x, v_DQ (2,), r) -> x', per second.
    g : (x, v_DQ) -> i_DQ (2,), out of the inverter.
    asked : (x, v_DQ, r, pq (2,)) -> (m,), zero where the set-points make p and q what they should
    be.
    """

    states: tuple[str, ...]
    f: ca.Function
    g: ca.Function
    asked: ca.Function

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, v_DQ, r) -> A, B (for v_DQ), C, D."""
        x, v_DQ, r = self._symbols()
        x_dot, i_DQ = self.f(x, v_DQ, r), self.g(x, v_DQ)
        matrices = [
            ca.jacobian(x_dot, x),
            ca.jacobian(x_dot, v_DQ),
            ca.jacobian(i_DQ, x),
            ca.jacobian(i_DQ, v_DQ),
        ]
        return ca.Function("linearised", [x, v_DQ, r], [ca.densify(m) for m in matrices])

    @cached_property
    def at_rest(self) -> ca.Function:
        """(x, v_DQ, r, pq) -> what is zero at rest (n + m,), and its Jacobian by (x, r)."""
        (x, v_DQ, r), pq = self._symbols(), ca.SX.sym("pq", 2)
        residual = ca.vertcat(self.f(x, v_DQ, r), self.asked(x, v_DQ, r, pq))
        return ca.Function(
            "at_rest",
            [x, v_DQ, r, pq],
            [residual, ca.densify(ca.jacobian(residual, ca.vertcat(x, r)))],
        )

    @property
    def set_points(self) -> int:
        """Number of set-points."""
        return self.f.numel_in(2)

    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return (
            ca.SX.sym("x", len(self.states)),
            ca.SX.sym("v_DQ", 2),
            ca.SX.sym("r", self.set_points),
        )
