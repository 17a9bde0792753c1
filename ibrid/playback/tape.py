"""A CasADi expression as a list of elementary operations that one compiled loop runs for many parameter sets at once.

A diagram gives an expression of its own, and compiling each would take longer than all its simulations. So the operations are
data of a loop that is compiled once. What depends on constants alone runs once for each simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ibrid.errors import IbridError

#: Operations of one or two operands that `steps` knows, by their number in CasADi.
_TWO = ("ADD", "SUB", "MUL", "DIV", "POW", "CONSTPOW", "LT", "LE", "EQ", "NE", "AND", "OR", "FMIN", "FMAX", "IF_ELSE_ZERO",
        "ATAN2", "HYPOT")  # fmt: skip
_ONE = (
    "ASSIGN", "NEG", "TWICE", "SQ", "SQRT", "INV", "SIN", "COS", "EXP", "LOG", "NOT", "FABS", "SIGN", "TANH", "ATAN",
)  # fmt: skip
OPERATIONS = {name: getattr(ca, f"OP_{name}") for name in (*_ONE, *_TWO)}
_TWO_NUMBERS = {OPERATIONS[name] for name in _TWO}


@dataclass(frozen=True, eq=False)
class Tape:
    """Operations in order: row k is (operation, result, first operand, second operand), places in a column of numbers.

    `before` : how many of them depend on constants alone. `size` : length of the column. `constants` : (place, value) of
    literal numbers. `inputs`, `outputs` : for each argument and result, the place of each of its entries; -1 of an input
    that is not used.
    """

    code: np.ndarray
    before: int
    size: int
    constants: tuple[np.ndarray, np.ndarray]
    inputs: tuple[np.ndarray, ...]
    outputs: tuple[np.ndarray, ...]


def tape_of(arguments: Sequence[ca.SX], results: Sequence[ca.SX], *, constant: Sequence[int] = ()) -> Tape:
    """The tape of results as functions of arguments; constant : numbers of the arguments that a simulation does not change."""
    each_once = ca.cse([ca.densify(one) for one in results])
    function = ca.Function("tape", list(arguments), each_once, {"live_variables": False})
    known = set(OPERATIONS.values())
    inputs = tuple(np.full(one.numel(), -1, dtype=np.int64) for one in arguments)
    outputs = tuple(np.zeros(one.numel(), dtype=np.int64) for one in results)
    places, values, moving = [], [], set()
    before, after = [], []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation == ca.OP_OUTPUT:
            (number, entry), (place,) = function.instruction_output(k), function.instruction_input(k)
            outputs[number][entry] = place
            continue
        place = function.instruction_output(k)[0]
        if operation == ca.OP_CONST:
            places.append(place)
            values.append(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            number, entry = function.instruction_input(k)
            inputs[number][entry] = place
            if number not in constant:
                moving.add(place)
        elif operation in known:
            operands = function.instruction_input(k)
            second = operands[1] if operation in _TWO_NUMBERS else operands[0]
            if moving.isdisjoint(operands):
                before.append((operation, place, operands[0], second))
            else:
                moving.add(place)
                after.append((operation, place, operands[0], second))
        else:
            raise IbridError(
                f"a law has the operation {operation} of CasADi, which playback does not know; write it otherwise"
            )
    code = np.array(before + after, dtype=np.uint64).reshape(-1, 4)  # unsigned: no check for negative places
    return Tape(
        code, len(before), function.sz_w(), (np.array(places, dtype=np.int64), np.array(values)), inputs, outputs
    )
