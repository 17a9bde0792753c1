"""One linear system by rows, on floats and CasADi symbols alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Row = dict[int, Any]


@dataclass(frozen=True)
class Interconnected:
    """x' = M_xx x + M_xv v, y = M_yx x + M_yv v, with delayed signals as further entries of x.

    `rows` : n + m rows of x (state derivatives, then what enters each delay) and 2 rows of y =
    i_DQ.
    `states` : names "instance.state". `delayed` : (instance, axis) of each delayed signal.
    """

    rows: tuple[Row, ...]
    states: tuple[str, ...]
    delayed: tuple[tuple[str, int], ...]

    @property
    def size(self) -> int:
        """Number of states, those of sampled delays included."""
        return len(self.states) + len(self.delayed)

    @classmethod
    def of(cls, whole: np.ndarray, states: Sequence[str]) -> "Interconnected":
        """[[A, B], [C, D]] in numbers as rows."""
        rows = tuple({int(j): float(row[j]) for j in np.flatnonzero(row)} for row in whole)
        return cls(rows, tuple(states), ())

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(A, B, C, D) of rows in numbers."""
        n = self.size
        whole = np.zeros((n + 2, n + 2))
        for i, row in enumerate(self.rows):
            whole[i, list(row)] = list(row.values())
        return whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]
