"""Bandwidth and damping of each control loop, from the model with that loop open and closed.

Where a regulator is cut, 1 + L(s) = det(sI - A) / det(sI - A_cut) with all other loops closed; on
both axes of dq that is det(I + L), of which the root is taken.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.analysis.models.modes import participation
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.structure.editing.loops import loops
from ibrid.structure.reading.parameters import parameter_table

#: Hz; where crossovers are looked for.
_GRID = np.geomspace(1e-3, 2e4, 4000)
#: Share of a loop's own states in a mode from which on the mode is that of the loop.
_SHARE = 0.05


@dataclass(frozen=True)
class LoopMode(Frozen):
    """A loop on an ideal grid, all others closed.

    `regulator` : module. `gains` : its parameters. `units` : theirs, "pu" for what has none.
    `bandwidth` : the first frequency (Hz) at which |L| falls through 1, None where it does not.
    `phase_margin` : degrees there. `damping` : -Re p / |p| of the mode of its states next to that
    frequency.
    """

    loop: str
    regulator: str
    gains: Mapping[str, float]
    units: Mapping[str, str]
    bandwidth: float | None
    phase_margin: float | None
    damping: float | None


def loop_modes(record: Record) -> tuple[LoopMode, ...]:
    """The loops of a record at its first operating point; empty where none is recognised or there
    is no fit.
    """
    by_title = loops(record.diagram, record.vocabulary) if record.parameters else {}
    if not by_title:
        return ()
    op = next(iter(record.parameters))
    matrix, states = record.state_matrix(op)
    shares = participation(matrix, states)
    wiring = record.wiring
    table = parameter_table(wiring, record.settings["equilibrium"])
    rows = []
    for title, members in by_title.items():
        for name in [name for name in members if wiring.kinds[name].regulates] or members[:1]:
            kind = wiring.kinds[name]
            gains = {
                one: float(table.value(name, one, record.parameters[op])) for one in kind.parameters
            }
            units = {key: _unit(box.unit) for key, box in kind.parameters.items()}
            cut = np.linalg.eigvals(record.state_matrix(op, cut=name)[0])
            axes = 2 if next(iter(kind.outputs.values())).width == 2 else 1
            bandwidth, margin = _crossover(shares.poles, cut, axes)
            own = [k for k, state in enumerate(states) if state.startswith(f"{name}.")]
            rows.append(
                LoopMode(
                    title,
                    name,
                    gains,
                    units,
                    bandwidth,
                    margin,
                    _damping(shares, own, bandwidth),
                )
            )
    return tuple(rows)


def loops_told(record: Record) -> tuple[LoopMode, ...]:
    """`loop_modes` for pages and texts, which show a record whatever is the matter with it."""
    try:
        return loop_modes(record)
    except IbridError:
        return ()


def _unit(unit: str) -> str:
    """Units of gains between per-unit signals have no name of their own: 1 is pu, 1/s pu/s."""
    return {"1": "pu", "1/s": "pu/s"}.get(unit, unit)


def _crossover(closed: np.ndarray, cut: np.ndarray, axes: int) -> tuple[float | None, float | None]:
    s = 2j * np.pi * _GRID[:, None]
    size = np.exp(np.log(np.abs(s - closed)).sum(axis=1) - np.log(np.abs(s - cut)).sum(axis=1))
    turn = np.angle(s - closed).sum(axis=1) - np.angle(s - cut).sum(axis=1)
    turn = np.unwrap(turn[::-1])[::-1]
    turn -= 2 * np.pi * np.round(turn[-1] / (2 * np.pi))  # nothing comes back at infinite frequency
    gain = size ** (1 / axes) * np.exp(1j * turn / axes) - 1
    falls = np.flatnonzero((np.abs(gain[:-1]) >= 1) & (np.abs(gain[1:]) < 1))
    if not len(falls):
        return None, None
    k = falls[0]
    margin = (np.degrees(np.angle(gain[k])) + 180 + 180) % 360 - 180
    return float(np.sqrt(_GRID[k] * _GRID[k + 1])), float(margin)


def _damping(shares: Any, own: Sequence[int], bandwidth: float | None) -> float | None:
    if not own or bandwidth is None:
        return None
    size = np.abs(shares.poles)
    there = np.flatnonzero((shares.shares[own].sum(axis=0) >= _SHARE) & (size > 0))
    if not len(there):
        return None
    best = there[np.argmin(np.abs(np.log(size[there] / (2 * np.pi * bandwidth))))]
    return float(-shares.poles[best].real / size[best])
