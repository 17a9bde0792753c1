"""What the declaration of a kind must satisfy, checked when it is made: names, shapes, delay, gain
at rest.
"""

import inspect
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ibrid.errors import ModuleError, near
from ibrid.signals import Signal

if TYPE_CHECKING:
    from ibrid.modules.kind import ModuleKind

_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")
#: The trial point of the operating point: a frame that is turned and equilibria with both
#: components.
TRIAL_OMEGA_0, TRIAL_FRAME, TRIAL_EQUILIBRIUM = 377.0, (0.8, 0.6), (0.9, 0.3)


def check_declaration(
    kind: "ModuleKind", words: Sequence[str], context: Sequence[str], suffix: str
) -> None:
    """Raise ModuleError, one sentence with the numbers, where a declaration contradicts itself.

    Parameters
    ----------
    words : what `kind.equilibrium` may name. context, suffix : further arguments that `state_space`
    may ask for.
    """
    _check_names(kind, words)
    _check_arguments(kind, context, suffix)
    a, b, c, d = _trial_matrices(kind)
    if kind.rests_by_law and (kind.states or kind.large_signal is None):
        raise ModuleError(
            f"{kind.name}: rests_by_law is for a kind without states and with a large_signal law, "
            f"got {len(kind.states)} states"
            f"{'' if kind.large_signal else ' and no law'}; leave it out"
        )
    _check_input_at_rest(kind, a)
    if kind.delay is not None:
        _check_delay(kind, d)
    elif kind.states and kind.dc_gain is not None:
        _check_dc_gain(kind, a, b, c, d)


def _check_names(kind: "ModuleKind", words: Sequence[str]) -> None:
    for what, names in (
        ("name", [kind.name]),
        ("port", [*kind.inputs, *kind.outputs]),
        ("state", [*kind.states]),
        ("parameter", [*kind.parameters]),
    ):
        for name in names:
            if not isinstance(name, str) or not _WORD.fullmatch(name):
                raise ModuleError(
                    f"{kind.name}: the {what} {name!r} must be a word of letters, digits and "
                    "underscores"
                )
        if twice := [name for name in names if names.count(name) > 1]:
            raise ModuleError(
                f"{kind.name}: each {what} needs a name of its own, {twice[0]} is there twice"
            )
    for name, signal in {**kind.inputs, **kind.outputs}.items():
        if not isinstance(signal, Signal):
            raise ModuleError(
                f"{kind.name}: the port {name} carries a Signal, such as Signal.SCALAR, got "
                f"{signal!r}"
            )
    if not kind.outputs:
        raise ModuleError(f"{kind.name}: a kind without outputs changes nothing; name at least one")
    if kind.states and not kind.inputs:
        raise ModuleError(
            f"{kind.name}: its {len(kind.states)} states have no input to move them; name at least "
            "one"
        )
    for port, word in kind.equilibrium.items():
        if port not in {**kind.inputs, **kind.outputs}:
            raise ModuleError(
                f"{kind.name}: equilibrium names {port!r}; "
                f"{near(port, [*kind.inputs, *kind.outputs])}"
            )
        if word not in words:
            raise ModuleError(
                f"{kind.name}: the equilibrium of {port} is called {word!r}; {near(word, words)}"
            )


def _check_arguments(kind: "ModuleKind", context: Sequence[str], suffix: str) -> None:
    arguments = tuple(inspect.signature(kind.state_space).parameters)
    if missing := [name for name in kind.parameters if name not in arguments]:
        raise ModuleError(
            f"{kind.name}: state_space lacks the argument {missing[0]}; it takes every parameter"
        )
    ports = {**kind.inputs, **kind.outputs}
    for name in arguments:
        given = name in context or (name.endswith(suffix) and name.removesuffix(suffix) in ports)
        if given and name in kind.parameters:
            raise ModuleError(
                f"{kind.name}: a parameter may not be called {name}, which assembly gives; rename "
                "it"
            )
        if not given and name not in kind.parameters:
            raise ModuleError(
                f"{kind.name}: state_space asks for {name}, which is no parameter, none of "
                f"{', '.join(context)} "
                f"and no PORT{suffix} of the ports {', '.join(ports)}"
            )


def _check_input_at_rest(kind: "ModuleKind", a: np.ndarray) -> None:
    """An input rests elsewhere than at zero only where something integrates, and by numbers of the
    kind's own.
    """
    if kind.input_at_rest is None:
        return
    asked = tuple(inspect.signature(kind.input_at_rest).parameters)
    allowed = (*kind.parameters, "deviation")
    if "deviation" not in asked or not set(asked) <= set(allowed):
        raise ModuleError(
            f"{kind.name}: input_at_rest takes deviation and parameters of the kind "
            f"({', '.join(allowed)}), found "
            f"{', '.join(asked) or 'no argument'}"
        )
    if [*kind.inputs.values()] != [Signal.SCALAR] or np.linalg.matrix_rank(a) == len(a):
        raise ModuleError(
            f"{kind.name}: input_at_rest is for a kind of one scalar input with a pole at zero, "
            "got the inputs "
            f"{', '.join(kind.inputs) or 'none'} and A = {a.tolist()}; leave it out"
        )


def _trial_matrices(kind: "ModuleKind") -> list[np.ndarray]:
    """A, B, C, D at typical parameters, with the shapes that ports and states ask for."""
    order, width_in, width_out = len(kind.states), width(kind.inputs), width(kind.outputs)
    shapes = {
        "A": (order, order),
        "B": (order, width_in),
        "C": (width_out, order),
        "D": (width_out, width_in),
    }
    returned = kind.state_space(**trial_arguments(kind))
    if not isinstance(returned, Sequence) or len(returned) != 4:
        number = len(returned) if isinstance(returned, Sequence) else type(returned).__name__
        raise ModuleError(
            f"{kind.name}: state_space returns four nested lists (A, B, C, D), got {number}"
        )
    matrices = []
    for (label, (height, columns)), rows in zip(shapes.items(), returned, strict=True):
        nested = isinstance(rows, Sequence) and all(isinstance(row, Sequence) for row in rows)
        lengths = [len(row) for row in rows] if nested else None
        if lengths != [columns] * height:
            raise ModuleError(
                f"{kind.name}: {order} states, {width_in} input and {width_out} output channels "
                f"need {label} of "
                f"{height} x {columns}, got "
                f"{f'rows of length {lengths}' if nested else 'no nested list'}"
            )
        matrix = np.array(rows, dtype=float).reshape(height, columns)
        if not np.isfinite(matrix).all():
            raise ModuleError(
                f"{kind.name}: {label} has an entry that is not finite at typical values"
            )
        matrices.append(matrix)
    return matrices


def trial_arguments(kind: "ModuleKind") -> dict[str, Any]:
    """Arguments of `state_space` at typical parameters and an operating point without special
    values.
    """
    equilibria = dict.fromkeys(kind.equilibrium_ports, TRIAL_EQUILIBRIUM)
    typical = {name: box.typical for name, box in kind.parameters.items()}
    return typical | kind.context(TRIAL_OMEGA_0, TRIAL_FRAME, equilibria)


def _check_delay(kind: "ModuleKind", d: np.ndarray) -> None:
    if kind.delay not in kind.parameters:
        raise ModuleError(f"{kind.name}: the delay {kind.delay} is not among its parameters")
    dq = [Signal.DQ_VEC]
    if (
        [*kind.inputs.values()] != dq
        or [*kind.outputs.values()] != dq
        or kind.states
        or (d != np.eye(2)).any()
    ):
        raise ModuleError(
            f"{kind.name}: a delay has one dq_vec input, one dq_vec output, no states and D = [[1, "
            "0], [0, 1]], got "
            f"{len(kind.inputs)} inputs, {len(kind.outputs)} outputs, {len(kind.states)} states "
            f"and D = {d.tolist()}; "
            "put what else it does into modules of their own"
        )


def _check_dc_gain(
    kind: "ModuleKind", a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
) -> None:
    """A gain at rest is one number, so it needs one input, and outputs of the same signal."""
    first, *others = kind.inputs
    signals = {kind.inputs[first], *kind.outputs.values()}
    deviations = all(
        kind.inputs[port] is Signal.SCALAR and port.startswith("delta") for port in others
    )
    if not deviations or len(signals) != 1:
        raise ModuleError(
            f"{kind.name}: dc_gain is for one input and outputs of the same signal, got "
            f"{len(kind.inputs)} inputs and "
            f"the signals {', '.join(sorted(signals))}; leave dc_gain None"
        )
    if np.linalg.matrix_rank(a) < len(a):
        raise ModuleError(
            f"{kind.name}: A is singular, so it integrates and has no gain at rest; leave dc_gain "
            "None"
        )
    own = kind.inputs[first].width  # what deviates is zero at rest
    at_rest = (d - c @ np.linalg.solve(a, b))[:, :own]
    wanted = float(kind.dc_gain or 0.0) * np.vstack([np.eye(own)] * len(kind.outputs))
    if np.abs(at_rest - wanted).max() > 1e-6 * max(1.0, np.abs(wanted).max()):
        raise ModuleError(
            f"{kind.name}: dc_gain = {kind.dc_gain:g}, but D - C A^-1 B at typical values is "
            f"{np.round(at_rest, 6).tolist()}; correct one of them, or leave dc_gain None if it "
            "depends on parameters"
        )


def width(ports: Mapping[str, Signal]) -> int:
    """Number of channels of a module's inputs or outputs."""
    return sum(signal.width for signal in ports.values())
