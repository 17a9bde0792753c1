"""Machine code of a CasADi expression answers as CasADi itself does."""

import math

import casadi as ca
import numpy as np
import pytest

from ibrid.errors import IbridError
from ibrid.playback.machine_code import LANES
from ibrid.playback.tape import tape_of

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
#: What playback knows, of one number or two.
LAWS = [
    X + Y,
    X - Y,
    X * Y,
    X / Y,
    -X,
    2 * X,
    X**2,
    X**3,
    X**Y,
    ca.fabs(X) ** Y,
    ca.fabs(X) ** 2.5,
    1 / X,
    ca.sqrt(X),
    ca.fabs(X),
    ca.sign(X),
    ca.sin(X),
    ca.cos(X),
    ca.tan(X),
    ca.asin(X),
    ca.acos(X),
    ca.atan(X),
    ca.atan2(X, Y),
    ca.sinh(X),
    ca.cosh(X),
    ca.tanh(X),
    ca.asinh(X),
    ca.acosh(X),
    ca.atanh(X),
    ca.exp(X),
    ca.expm1(X),
    ca.log(X),
    ca.log1p(X),
    ca.hypot(X, Y),
    ca.erf(X),
    ca.floor(X),
    ca.ceil(X),
    ca.fmod(X, Y),
    ca.remainder(X, Y),
    ca.copysign(X, Y),
    ca.fmin(X, Y),
    ca.fmax(X, Y),
    X < Y,
    X <= Y,
    X == Y,
    X != Y,
    ca.logic_not(X),
    ca.logic_and(X, Y),
    ca.logic_or(X, Y),
    ca.if_else(X < Y, X, Y),
    ca.SX(0.5),
]


def run(arguments: list[ca.SX], results: list[ca.SX], numbers: np.ndarray) -> np.ndarray:
    """Results (r, S) at numbers (n, S), the first argument's, the others constant."""
    tape = tape_of(arguments, results, constant=range(1, len(arguments)))
    w = np.zeros((tape.rows, numbers.shape[1]))
    w[: len(numbers)] = numbers
    for code in (tape.once, tape.each):
        code(w.ctypes.data, numbers.shape[1])
    return w[tape.results :]


@pytest.mark.slow
def test_each_operation_is_that_of_casadi() -> None:
    rng = np.random.default_rng(0)
    special = [[0, 0, 1, 2, np.nan, np.nan, 1, -np.inf], [0, 1, 0, 2, np.nan, 1, np.nan, 1]]
    pairs = np.concatenate([rng.normal(scale=2.0, size=(2, 96)), special], axis=1)
    wrong = []
    for law in LAWS:
        expected = np.array([float(ca.Function("law", [X, Y], [law])(*pair)) for pair in pairs.T])
        for arguments in ([ca.vertcat(X, Y)], [X, Y]):
            (found,) = run(arguments, [law], pairs)
            # multiplications and additions may be joined, and functions be those of another
            # library: some last digits
            if not np.allclose(found, expected, rtol=1e-14, atol=1e-300, equal_nan=True):
                wrong.append((law, found - expected))
    assert not wrong


def test_sine_and_cosine_are_right_to_the_last_digit_for_thousands_of_turns() -> None:
    angle = np.concatenate([np.linspace(-8, 8, 4000), np.linspace(-3e4, 3e4, 4000)])
    found = run([X], [ca.sin(X), ca.cos(X)], angle[None])
    # math has half a last digit (1.1e-16 near one) on every processor; the vectors of numpy have
    # not
    expected = [[math.sin(one) for one in angle], [math.cos(one) for one in angle]]
    assert np.abs(found - expected).max() < 2.3e-16


def test_what_is_no_number_stays_none_and_touches_no_other() -> None:
    found = run([X], [ca.sin(X), ca.cos(X), X * 2], np.array([[np.nan, np.inf, 1.0, 0.0]]))
    assert np.isnan(found[:, 0]).all()
    assert np.isnan(found[:2, 1]).all()
    # functions of two libraries: some last digits (2e-16)
    assert np.allclose(found[:, 2:], [[np.sin(1), 0], [np.cos(1), 1], [2, 0]], rtol=1e-14)


def test_what_constants_alone_decide_runs_once() -> None:
    tape = tape_of([X, Y], [X * ca.exp(Y)], constant=[1])
    w = np.zeros((tape.rows, LANES))
    w[0], w[1] = 2.0, 3.0
    tape.once(w.ctypes.data, LANES)
    w[1] = 100.0
    tape.each(w.ctypes.data, LANES)
    # functions of two libraries: some last digits (2e-16)
    assert np.allclose(w[tape.results], 2 * np.exp(3), rtol=1e-14)


def test_an_operation_that_playback_does_not_know_is_told() -> None:
    with pytest.raises(IbridError, match="playback does not know"):
        tape_of([X], [ca.erfinv(X)])
