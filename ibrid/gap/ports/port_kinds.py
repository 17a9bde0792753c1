"""Module kinds of the diagrams of ports: the unknown transfer function, scalar and dq, and J."""

from collections.abc import Callable

from ibrid.modules.kind import Matrices, ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal


def _lag() -> Matrices:
    """Return A, B, C, D of a lag of 1 s."""
    return [[-1]], [[1]], [[1]], [[0]]


def _lag_dq() -> Matrices:
    """Return A, B, C, D of a lag of 1 s on both axes."""
    return [[-1, 0], [0, -1]], [[1, 0], [0, 1]], [[1, 0], [0, 1]], [[0, 0], [0, 0]]


def _rotation_by_90() -> Matrices:
    """Return A, B, C, D of a rotation by 90 degrees."""
    return [], [], [[], []], [[0, -1], [1, 0]]


def _kind(
    name: str,
    law: str,
    signal: Signal,
    state_space: Callable[[], Matrices],
    states: tuple[str, ...] = (),
) -> ModuleKind:
    """Build a kind with one input and one output."""
    return ModuleKind(
        name=name,
        family="dynamic control" if states else "static",
        law=law,
        inputs={"in_": signal},
        outputs={"out": signal},
        states=states,
        state_space=state_space,
        dc_gain=1.0 if states else None,
        extended=True,
        reference="the port map of the gap workflow",
    )


_LAW = (
    "out = (1 + Delta) in_, Delta unknown at each frequency; where a diagram asks for numbers, a "
    "lag of 1 s"
)
UNKNOWN = _kind("Unknown", _LAW, Signal.SCALAR, _lag, ("through",))
UNKNOWN_DQ = _kind("Unknown_dq", _LAW, Signal.DQ_VEC, _lag_dq, ("through_d", "through_q"))
QUARTER_TURN = _kind("Quarter_turn", "out = J in_", Signal.DQ_VEC, _rotation_by_90)
PORT_KINDS: Vocabulary = (UNKNOWN, UNKNOWN_DQ, QUARTER_TURN)


def unknown_kind(signal: Signal) -> str:
    """Return the name of the kind of an unknown transfer function on a signal."""
    return (UNKNOWN_DQ if signal is Signal.DQ_VEC else UNKNOWN).name
