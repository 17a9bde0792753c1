"""What diagrams of ports have beside the vocabulary: the unknown transfer, on a scalar and on both
axes, and J.
"""

from collections.abc import Callable

from ibrid.modules.kind import Matrices, ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.signals import Signal


def _unknown() -> Matrices:
    return [[-1]], [[1]], [[1]], [[0]]


def _unknown_dq() -> Matrices:
    return [[-1, 0], [0, -1]], [[1, 0], [0, 1]], [[1, 0], [0, 1]], [[0, 0], [0, 0]]


def _quarter_turn() -> Matrices:
    return [], [], [[], []], [[0, -1], [1, 0]]


def _kind(
    name: str,
    law: str,
    signal: Signal,
    state_space: Callable[[], Matrices],
    states: tuple[str, ...] = (),
):
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
UNKNOWN = _kind("Unknown", _LAW, Signal.SCALAR, _unknown, ("through",))
UNKNOWN_DQ = _kind("Unknown_dq", _LAW, Signal.DQ_VEC, _unknown_dq, ("through_d", "through_q"))
QUARTER_TURN = _kind("Quarter_turn", "out = J in_", Signal.DQ_VEC, _quarter_turn)
PORT_KINDS: Vocabulary = (UNKNOWN, UNKNOWN_DQ, QUARTER_TURN)


def unknown(signal: Signal) -> str:
    """Name of the unknown transfer's kind on a signal."""
    return (UNKNOWN_DQ if signal is Signal.DQ_VEC else UNKNOWN).name
