"""An inverter on a grid with series R and L: the state matrix of both together, in the DQ frame of the PCC."""

import numpy as np

from ibrid.analysis.grid import J, SeriesRL
from ibrid.errors import IbridError

#: Smallest singular value of a direct term over the largest that counts as its rank.
RANK = 1e-12
#: Condition number from which on v_PCC does not follow from the states.
SINGULAR = 1e12


def behind_grid(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, grid: SeriesRL
) -> tuple[np.ndarray, tuple[str, ...]]:
    """State matrix of dx/dt = A x + B v, i = C x + D v joined with v = (r + x s/omega_0 + x J) i.

    The grid's inductor is in series with what the inverter has at its terminals. With D = 0 its current is C x, which the
    inverter's states hold already, so no state is added and v follows from di/dt = C (A x + B v). Where D passes some
    combination of v on (a resistive branch at the PCC), the same combination of the current is a state of its own.

    Returns the matrix (m, m), m = n + rank D, and the names of the added states.
    Raises IbridError where v does not follow.
    """
    left, sizes, right = np.linalg.svd(D)
    rank = int((sizes > RANK * max(1.0, float(sizes[0]))).sum())
    own, shared = (
        left[:, :rank],
        left[:, rank:],
    )  # current combinations that are states of the grid, and of the inverter
    direct, rest = right[:rank].T, right[rank:].T  # voltage combinations that D passes on, and the others
    l = grid.x / grid.omega_0
    drop = grid.r * np.eye(2) + grid.x * J
    n = len(A)
    # i = own j + shared shared' C x, v = direct u + rest w, u = (j - own' C x) / sizes, over z = (x, j)
    i = np.hstack([shared @ shared.T @ C, own])
    u = np.hstack([-own.T @ C, np.eye(rank)]) / sizes[:rank, None]
    known = direct @ u
    # shared' (l di/dt) = shared' (v - drop i) with shared' di/dt = shared' C (A x + B v)
    through = l * shared.T @ C @ B - shared.T
    forced = np.hstack([l * shared.T @ C @ A, np.zeros((2 - rank, rank))]) + shared.T @ drop @ i + through @ known
    if rank < 2:
        square = through @ rest
        if np.linalg.cond(square) > SINGULAR:
            raise IbridError(
                "the PCC voltage does not follow from the model and the grid: its inductances cancel; check the parameters"
            )
        v = known - rest @ np.linalg.solve(square, forced)
    else:
        v = known
    top = np.hstack([A, np.zeros((n, rank))]) + B @ v
    # own' l di/dt = own' (v - drop i), i = own j + what the inverter's states hold
    bottom = own.T @ (v - drop @ i) / l
    return np.vstack([top, bottom]), tuple(f"grid.i_{k + 1}" for k in range(rank))
