"""The CasADi path: matrices of a diagram as functions of its parameters and the operating point.

One generalised system per operating point: Phi(omega) x = M_xx x + M_xv v, i = M_yx x + M_yv v,
where Phi is j omega for a state and exp(j omega T) for a delayed signal. So an exact delay is one
more row, and every structure has one form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ibrid.assembly.interconnection import Interconnected, interconnect_rows
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numbers import Scalar
from ibrid.structure.reading.parameters import (
    Parameter,
    ParameterTable,
    parameter_table,
    parameters_at,
)
from ibrid.structure.reading.wiring import Wiring


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the numbers of M and of its derivatives stand, and which rows are delayed signals.

    `size` : number of states and delayed signals.
    `rows`, `columns` : (nz,) places in the (size + 2) x (size + 2) matrix M = [[M_xx, M_xv], [M_yx,
    M_yv]]. `derivative_entry`, `derivative_parameter` : (nd,) which entry by which parameter.
    `delay_parameter` : (size,) index of the free delay of a row, -1 for a state, -2 for a fixed
    delay.
    `delay_fixed` : (size,) seconds of fixed delays.
    """

    size: int
    rows: np.ndarray
    columns: np.ndarray
    derivative_entry: np.ndarray
    derivative_parameter: np.ndarray
    delay_parameter: np.ndarray
    delay_fixed: np.ndarray

    def delays(self, theta: np.ndarray) -> np.ndarray:
        """Delay of each row in s, -1 for a state: theta (S, P) -> (S, size)."""
        delays = np.full((len(theta), self.size), -1.0)
        free, fixed = self.delay_parameter >= 0, self.delay_parameter == -2
        delays[:, free] = theta[:, self.delay_parameter[free]]
        delays[:, fixed] = self.delay_fixed[fixed]
        return delays


@dataclass(frozen=True, eq=False)
class SymbolicModel:
    """Non-zero entries of M and their derivatives as functions, with the pattern that places them.

    `entries` : Function (theta (P,), point (3,)) -> (values (nz,), derivatives (nd,)).
    `values_only` : Function (theta, point) -> values (nz,).
    """

    parameters: tuple[Parameter, ...]
    states: tuple[str, ...]
    pattern: Pattern
    entries: ca.Function
    values_only: ca.Function


def symbolic_model(
    wiring: Wiring, *, equilibrium: str, power_node: str, omega_0: float
) -> SymbolicModel:
    """Build the matrices of a legal diagram as CasADi functions of its free parameters, with exact
    delays.

    Raises DiagramError where the operating point of a module does not follow from the plant.
    """
    table, theta, point, joined = _joined(
        wiring, None, equilibrium, power_node=power_node, omega_0=omega_0
    )
    places = [
        (i, j, value) for i, row in enumerate(joined.rows) for j, value in sorted(row.items())
    ]
    values = ca.vertcat(*[value for _, _, value in places]) if places else ca.SX(0, 1)
    values = ca.densify(ca.SX(values))
    jacobian = ca.jacobian(values, theta)
    entry, parameter = jacobian.sparsity().get_triplet()
    delays = [table.bound[name, str(wiring.kinds[name].delay)] for name, _ in joined.delayed]
    delay_parameter, delay_fixed = _delays(
        delays, [one.name for one in table.free], len(joined.states)
    )
    pattern = Pattern(
        size=joined.size,
        rows=np.array([i for i, _, _ in places], dtype=np.int64),
        columns=np.array([j for _, j, _ in places], dtype=np.int64),
        derivative_entry=np.array(entry, dtype=np.int64),
        derivative_parameter=np.array(parameter, dtype=np.int64),
        delay_parameter=delay_parameter,
        delay_fixed=delay_fixed,
    )
    return SymbolicModel(
        parameters=table.free,
        states=joined.states,
        pattern=pattern,
        entries=ca.Function(
            "entries",
            [theta, point],
            [values, ca.densify(jacobian.nz[:]) if jacobian.nnz() else ca.SX(0, 1)],
        ),
        values_only=ca.Function("values", [theta, point], [values]),
    )


def symbolic_matrices(
    wiring: Wiring,
    pade_orders: dict[str, int],
    *,
    equilibrium: str,
    power_node: str,
    omega_0: float,
) -> ca.Function:
    """(theta, point) -> (A, B, C, D), dense, with Pade forms of the delays; states as in
    `numeric.closed_loop`.
    """
    _, theta, point, joined = _joined(
        wiring, pade_orders, equilibrium, power_node=power_node, omega_0=omega_0
    )
    whole = ca.SX(joined.size + 2, joined.size + 2)
    for i, row in enumerate(joined.rows):
        for j, value in row.items():
            whole[i, j] = value
    n = joined.size
    return ca.Function(
        "matrices", [theta, point], [whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]]
    )


def _joined(
    wiring: Wiring,
    pade_orders: dict[str, int] | None,
    equilibrium: str,
    *,
    power_node: str,
    omega_0: float,
) -> tuple[ParameterTable, ca.SX, ca.SX, Interconnected]:
    """The parameters, symbols theta of the free ones and point (p, q, v), and the rows they give.

    Without Pade orders the delays stay exact.
    """
    table = parameter_table(wiring, equilibrium)
    theta, point = ca.SX.sym("theta", len(table.free)), ca.SX.sym("point", 3)
    symbols = {parameter.name: Scalar(theta[index]) for index, parameter in enumerate(table.free)}
    parameters = parameters_at(wiring, table, symbols)
    at = (Scalar(point[0]), Scalar(point[1]), Scalar(point[2]))
    physics: dict[str, Any] = {
        "equilibrium": equilibrium,
        "power_node": power_node,
        "omega_0": omega_0,
    }
    matrices = module_matrices(wiring, parameters, at, pade_orders=pade_orders, **physics)
    return (
        table,
        theta,
        point,
        interconnect_rows(wiring, matrices, exact_delays=pade_orders is None),
    )


def _delays(
    delays: Sequence[str | float], free: Sequence[str], states: int
) -> tuple[np.ndarray, np.ndarray]:
    """`delay_parameter` and `delay_fixed` of a `Pattern`.

    delays : free name or seconds, of each row behind the states.
    """
    parameter = np.full(states + len(delays), -1, dtype=np.int64)
    fixed = np.zeros(states + len(delays))
    for index, bound in enumerate(delays, start=states):
        if isinstance(bound, str):
            parameter[index] = free.index(bound)
        else:
            parameter[index], fixed[index] = -2, bound
    return parameter, fixed
