"""What every kind of the vocabulary keeps to, measured at random points; for the test of a kind of
one's own.
"""

from collections.abc import Mapping, Sequence
from inspect import signature
from math import atan2
from typing import Any

import casadi as ca
import numpy as np

from ibrid.errors import ModuleError
from ibrid.modules.behaviour import numbers_of, responses
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.large_signal import LargeSignal

#: Two orders of the same operations differ by a few roundings.
ROUNDING = 1e-15
#: Relative change of the response below which an argument counts as without effect.
NO_EFFECT = 1e-9
#: Smallest singular value of [s I - A, B] over its norm, below which a state counts as not moved
#: (or not seen).
IDLE = 1e-9
#: Where a law is evaluated, rad/s.
POINTS = 1j * np.geomspace(1.0, 1e5, 11)


def complaints_about(
    kind: ModuleKind, rng: np.random.Generator | None = None, *, points: int = 10
) -> tuple[str, ...]:
    """Sentences about what a kind does otherwise than those that ship; `ibrid.testing.check_kind`
    raises them.

    kind : one's own. rng : for the draws; by default the same ones every time. points : number of
    draws.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    try:
        symbolic = _symbolic(kind)
    except ModuleError as complaint:
        return (str(complaint),)
    complaints: dict[str, None] = {}
    checks = (
        lambda given, values: _check_symbols(given, symbolic, values),
        _check_effects,
        _check_states,
    )
    for _ in range(points):
        arguments = _draw(kind, rng)
        for check in (*checks, check_linearisation):
            try:
                check(kind, arguments)
            except ModuleError as complaint:
                complaints[str(complaint)] = None
        if complaints:  # another draw would say the same with other numbers
            break
    return tuple(complaints)


def _draw(kind: ModuleKind, rng: np.random.Generator) -> dict[str, Any]:
    """Arguments of `state_space` within a factor of ten of the typical ones."""
    values = {name: _draw_within(box, rng) for name, box in kind.parameters.items()}
    angle = rng.uniform(-0.5, 0.5)
    equilibria = {
        port: (float(rng.uniform(0.5, 1.5)), float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.5)))
        for port in kind.equilibrium_ports
    }
    frame = (float(np.cos(angle)), float(np.sin(angle)))
    return values | kind.context(float(2 * np.pi * rng.uniform(50, 60)), frame, equilibria)


def _draw_within(box: Range, rng: np.random.Generator) -> float:
    if box.logarithmic:
        return float(np.clip(box.typical * 10 ** rng.uniform(-1, 1), box.low, box.high))
    return float(rng.uniform(box.low, box.high))


def _symbolic(kind: ModuleKind) -> ca.Function:
    """All arguments, pairs laid flat, -> all entries of A, B, C, D, and the states at rest."""
    symbols: dict[str, Any] = {}
    flat = []
    for name, value in _draw(kind, np.random.default_rng(0)).items():
        some = [ca.SX.sym(f"{name}_{index}") for index in range(np.size(value))]
        symbols[name] = tuple(some) if isinstance(value, tuple) else some[0]
        flat += some
    try:
        entries = [entry for rows in kind.state_space(**symbols) for row in rows for entry in row]
        entries += _at_rest(kind, symbols)
        return ca.Function("entries", flat, [ca.vertcat(*[ca.SX(entry) for entry in entries])])
    except (TypeError, RuntimeError, NotImplementedError) as error:
        reason = str(error).strip().splitlines()[-1]
        raise ModuleError(
            f"{kind.name}: state_space and at_rest must work with CasADi symbols as with numbers, "
            "with + - * / and, at rest, "
            f"square_root; found {type(error).__name__}: {reason}"
        ) from error


def _at_rest(kind: ModuleKind, arguments: Mapping[str, Any]) -> list[Any]:
    """Where a large-signal law says that states rest; nothing without."""
    at_rest = kind.large_signal and kind.large_signal.at_rest
    return [*at_rest(**_asked(kind, at_rest, arguments))] if at_rest else []


def _check_symbols(kind: ModuleKind, symbolic: ca.Function, arguments: dict[str, Any]) -> None:
    flat = [
        one
        for value in arguments.values()
        for one in (value if isinstance(value, tuple) else (value,))
    ]
    numbers = np.concatenate(
        [*(part.ravel() for part in numbers_of(kind, arguments)), _at_rest(kind, arguments)]
    )
    by_symbols = np.array(symbolic.call([ca.DM(one) for one in flat])[0]).ravel()
    wrong = ~(
        np.abs(by_symbols - numbers) <= ROUNDING * np.abs(numbers)
    )  # float(symbol) is not a number
    if wrong.any():
        raise ModuleError(
            f"{kind.name}: matrices and states at rest must be the same for symbols and numbers; "
            "an entry is "
            f"{by_symbols[wrong][0]:.17g} with symbols and {numbers[wrong][0]:.17g} with numbers, "
            "is there a comparison or a "
            "conversion in state_space or at_rest?"
        )


def _check_effects(kind: ModuleKind, arguments: dict[str, Any]) -> None:
    before = responses(kind, arguments, POINTS)
    for name, value in arguments.items():
        if name == kind.delay or name in kind.shares or name in kind.rest_parameters:
            continue  # outside the matrices
        after = responses(kind, arguments | {name: _changed(value)}, POINTS)
        if np.abs(after - before).max() <= NO_EFFECT * np.abs(before).max():
            raise ModuleError(
                f"{kind.name}: {name} must change the response; it does not, leave it out of "
                "state_space"
            )


def _changed(value: Any) -> Any:
    if isinstance(value, tuple):  # turned by 0.1 rad and longer
        c, s = np.cos(0.1), np.sin(0.1)
        return (1.1 * (c * value[0] - s * value[1]), 1.1 * (s * value[0] + c * value[1]))
    return 1.1 * value


def _check_states(kind: ModuleKind, arguments: dict[str, Any]) -> None:
    """Popov, Belevitch and Hautus: [s I - A, B] and [s I - A; C] keep their rank at every pole."""
    a, b, c, _ = numbers_of(kind, arguments)
    for pole in np.linalg.eigvals(a):
        shifted = pole * np.eye(len(a)) - a
        for whole, what in (
            (np.hstack([shifted, b]), "moved by an input"),
            (np.vstack([shifted, c]), "seen by an output"),
        ):
            size = np.linalg.svd(whole, compute_uv=False)
            if size[-1] <= IDLE * size[0]:
                raise ModuleError(
                    f"{kind.name}: each of its {len(a)} states must be {what}; that with the pole "
                    f"{pole:.6g} rad/s is "
                    "not, leave it out"
                )


#: Exact derivatives of two ways to write a law differ by a few roundings.
EXACT = 1e-12


def check_linearisation(kind: ModuleKind, arguments: Mapping[str, Any]) -> None:
    """Raise ModuleError unless the derivatives of `kind.large_signal` are the matrices of
    `kind.state_space`.

    arguments : of `state_space`, in numbers, an operating point whose frame and equilibria are
    arbitrary.
    """
    if kind.large_signal is None:
        return
    found = _derivatives(kind, kind.large_signal, arguments)
    expected = [np.array(rows, dtype=float) for rows in kind.state_space(**arguments)]
    for name, matrix, other in zip("ABCD", found, expected, strict=True):
        other = other.reshape(matrix.shape)
        if matrix.size and not np.abs(matrix - other).max() <= EXACT * max(
            1.0, np.abs(other).max()
        ):
            row, column = np.unravel_index(np.argmax(np.abs(matrix - other)), matrix.shape)
            raise ModuleError(
                f"{kind.name}: the large-signal law must linearise to the state space; "
                f"{name}[{row}, {column}] is "
                f"{matrix[row, column]:.10g} by the law and {other[row, column]:.10g} in "
                "state_space, correct one of them"
            )


def _derivatives(
    kind: ModuleKind, large: LargeSignal, arguments: Mapping[str, Any]
) -> list[np.ndarray]:
    """A, B, C, D of the law, by CasADi."""
    x = ca.SX.sym("x", len(kind.states))
    inputs, resting = {}, []
    for port, signal in kind.inputs.items():
        some = ca.SX.sym(port, signal.width)
        inputs[port] = some if signal.width == 1 else (some[0], some[1])
        if port == large.angle:
            c, s = arguments.get("frame", (1.0, 0.0))
            resting.append(atan2(s, c))
        else:
            resting += arguments.get(f"{port}_eq", (0.0, 0.0))[: signal.width]
    u = ca.vertcat(
        *[ca.vertcat(*one) if isinstance(one, tuple) else one for one in inputs.values()]
    )
    constants = _asked(kind, large.law, arguments)
    rates, outputs = large.law(tuple(x[k] for k in range(len(kind.states))), **inputs, **constants)
    parts = [ca.vertcat(*map(ca.SX, one)) if len(one) else ca.SX(0, 1) for one in (rates, outputs)]
    jacobians = [ca.densify(ca.jacobian(part, by)) for part in parts for by in (x, u)]
    point = [ca.DM(_at_rest(kind, arguments)), ca.DM(resting)]
    return [np.array(one) for one in ca.Function("derivatives", [x, u], jacobians).call(point)]


def _asked(kind: ModuleKind, function: Any, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the arguments of `state_space` that a law has; ModuleError where it has others."""
    names = [
        name for name in signature(function).parameters if name != "x" and name not in kind.inputs
    ]
    if unknown := [name for name in names if name not in arguments]:
        raise ModuleError(
            f"{kind.name}: its large-signal law asks for {unknown[0]}, which is neither x, an "
            "input nor an argument of "
            f"state_space ({', '.join(arguments)})"
        )
    return {name: arguments[name] for name in names}


def require_no_complaints(subject: str, complaints: Sequence[str]) -> None:
    """AssertionError with all complaints about a subject, each once, where there are any."""
    if different := list(dict.fromkeys(complaints)):
        raise AssertionError(
            f"{subject} breaks its contract:\n"
            + "\n".join(f"- {complaint}" for complaint in different)
        )
