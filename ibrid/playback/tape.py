"""A CasADi expression as machine code that runs for many parameter sets at once.

What depends on constants alone runs once for each simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ibrid.playback.machine_code import Code, Operation, Routine, machine_code


@dataclass(frozen=True, eq=False)
class Tape:
    """Operations on (rows, S) numbers, S a multiple of `LANES`: `once`, those on constants alone,
    and `each`, all others.

    The rows are the entries of the arguments in order, what is calculated once, and, from `results`
    on, the entries of the results in order.
    """

    once: Code
    each: Code
    rows: int
    results: int


def tape_of(
    arguments: Sequence[ca.SX],
    results: Sequence[ca.SX],
    *,
    constant: Sequence[int] = (),
    optimised: bool = True,
) -> Tape:
    """The tape of results as functions of arguments.

    constant : numbers of the arguments that a simulation does not change. optimised : as of
    `machine_code`.
    """
    each_once = ca.cse([ca.densify(one) for one in results])
    function = ca.Function("tape", list(arguments), each_once, {"live_variables": False})
    arguments_at = np.cumsum([0, *(one.numel() for one in arguments)])
    results_at = np.cumsum([0, *(one.numel() for one in results)])
    literals, rows, moving, written = (
        dict[int, float](),
        dict[int, int](),
        set[int](),
        list[tuple[int, int]](),
    )
    once, each = list[Operation](), list[Operation]()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation == ca.OP_OUTPUT:
            (number, entry), (place,) = (
                function.instruction_output(k),
                function.instruction_input(k),
            )
            written.append((place, int(results_at[number]) + entry))
            continue
        place = function.instruction_output(k)[0]
        if operation == ca.OP_CONST:
            literals[place] = function.instruction_constant(k)
        elif operation == ca.OP_INPUT:
            number, entry = function.instruction_input(k)
            rows[place] = int(arguments_at[number]) + entry
            if number not in constant:
                moving.add(place)
        elif moving.isdisjoint(operands := function.instruction_input(k)):
            once.append((operation, place, operands))
        else:
            moving.add(place)
            each.append((operation, place, operands))
    calculated = {place: int(arguments_at[-1]) + k for k, (_, place, _) in enumerate(once)}
    first = int(arguments_at[-1]) + len(once)
    routines = [
        Routine(once, rows, [*calculated.items()]),
        Routine(each, rows | calculated, [(place, first + row) for place, row in written]),
    ]
    once_code, each_code = machine_code(routines, literals, optimised=optimised)
    return Tape(once_code, each_code, first + int(results_at[-1]), first)
