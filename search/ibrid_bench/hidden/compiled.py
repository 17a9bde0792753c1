"""Equations of motion as compiled loops: a CasADi function written out as scalar statements and
compiled by numba.

Fixed steps of the classical Runge-Kutta method; the injected voltage is a sinusoid on one axis.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ibrid.errors import IbridError
from ibrid.fit.just_in_time import njit

#: CasADi's operations as Python expressions of their arguments.
_EXPRESSIONS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_FMIN: "min({0}, {1})",
    ca.OP_FMAX: "max({0}, {1})",
    ca.OP_FABS: "abs({0})",
}

#: (state, time, [omega, a_d, a_q], arguments, step, steps) -> sums of window, i_DQ cos and i_DQ
#: sin; moves the state.
Record = Callable[..., np.ndarray]


def compiled(function: ca.Function) -> Any:
    """A function of (x, v, a) -> (x', y) as compiled code that writes x' and y, in this order, into
    its last argument.

    Raises IbridError for an operation that is not in the table above.
    """
    names = ("x", "v", "a")
    lines = ["def written(x, v, a, out):"]
    places = np.cumsum([0, *(function.numel_out(k) for k in range(function.n_out()))])
    for k in range(function.n_instructions()):
        operation, taken = function.instruction_id(k), function.instruction_input(k)
        given = function.instruction_output(k)
        if operation == ca.OP_INPUT:
            lines.append(f"    w{given[0]} = {names[taken[0]]}[{taken[1]}]")
        elif operation == ca.OP_OUTPUT:
            lines.append(f"    out[{places[given[0]] + given[1]}] = w{taken[0]}")
        elif operation == ca.OP_CONST:
            lines.append(f"    w{given[0]} = {function.instruction_constant(k)!r}")
        elif operation in _EXPRESSIONS:
            expression = _EXPRESSIONS[operation].format(*(f"w{one}" for one in taken))
            lines.append(f"    w{given[0]} = {expression}")
        else:
            raise IbridError(
                f"the equations hold an operation ({operation}) that is not compiled; add it to "
                "the table."
            )
    scope: dict[str, Any] = {"sqrt": np.sqrt, "sin": np.sin, "cos": np.cos}
    exec("\n".join(lines), scope)
    return njit(scope["written"], error_model="numpy")


def recorder(written: Callable[..., None], size: int) -> Record:
    """The loop over one record of equations with `size` states, compiled.

    Law: with t from 0 to T of the record, sums of (1 - cos(2 pi t / T)) i_DQ(t) e^-j omega t over
    its steps; the Hann window suppresses what still decays at other frequencies.
    """

    @njit(error_model="numpy")
    def rates(x, time, injected, v, a, out):
        wave = np.sin(injected[0] * time)
        written(x, np.array([v[0] + injected[1] * wave, v[1] + injected[2] * wave]), a, out)

    @njit(error_model="numpy")
    def record(x, begun, injected, v, a, step, steps):
        k1, k2, k3, k4 = (
            np.zeros(size + 2),
            np.zeros(size + 2),
            np.zeros(size + 2),
            np.zeros(size + 2),
        )
        sums = np.zeros(4)
        for number in range(steps):
            time = begun + number * step
            rates(x, time, injected, v, a, k1)
            window = 1.0 - np.cos(2.0 * np.pi * number / steps)
            cosine, sine = np.cos(injected[0] * time), np.sin(injected[0] * time)
            for axis in range(2):
                sums[axis] += window * k1[size + axis] * cosine
                sums[2 + axis] += window * k1[size + axis] * sine
            rates(x + 0.5 * step * k1[:size], time + 0.5 * step, injected, v, a, k2)
            rates(x + 0.5 * step * k2[:size], time + 0.5 * step, injected, v, a, k3)
            rates(x + step * k3[:size], time + step, injected, v, a, k4)
            for one in range(size):
                x[one] += step / 6.0 * (k1[one] + 2.0 * k2[one] + 2.0 * k3[one] + k4[one])
        return sums

    return record
