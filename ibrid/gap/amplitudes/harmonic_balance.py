"""The periodic motion of a linear model with one nonlinearity at a port, by harmonic balance.

The port of an opened model has the input z = Z_u v + Z_w w. With a memoryless w = F(z) in place of
w = z, the harmonics of z obey z_h = Z_u v (h = 1) + Z_w(j h omega) w_h for h = 0 .. HARMONICS. With
the first alone this is the describing-function method, where the gain N(A) depends on the amplitude
at the port that it sets itself; h = 0 is the shift of the mean, which integrating loops hold, and
the others are the distortion that the loops feed back.

C = K M L 2 cells (frequency, operating point, amplitude, injected axis) are solved together; r is 1
for a scalar port and 2 for dq.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.gap.amplitudes.nonlinearities import Nonlinearity
from ibrid.gap.ports.open_port import OpenedModel, OpenPort

#: Harmonics beside the mean, and samples of a period.
HARMONICS = 3
SAMPLES = 96
#: rad/s, real: stands for s = 0, where integrators have no response; on the imaginary axis theirs
#: would be imaginary.
SLOWEST = 1e-3
#: Newton steps at most, and the parts of a step that are tried where the whole one is no gain.
NEWTON_STEPS = 20
SHORTER_STEPS = (0.5, 0.25, 0.1, 0.03)
#: Residual of the balance, relative to the drive, at which Newton's method ends, and up to which a
#: motion counts as balanced.
CONVERGED = 1e-9
BALANCED = 1e-4
#: Parts of the signal that the nonlinearity passes, for initial motions, and how many are tried.
INITIAL_GAINS = tuple(np.linspace(0.0, 1.0, 21))
MOST_TRIED = 4
#: Drive, per unit, that stands for none.
LEAST_DRIVE = 1e-12

_PHASE = 2.0 * np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES
_WAVES = [np.ones(SAMPLES)]
for _h in range(1, HARMONICS + 1):
    _WAVES += [np.cos(_h * _PHASE), -np.sin(_h * _PHASE)]
#: Coefficients (mean, real and imaginary part of each harmonic) -> samples, and back.
BASIS = np.array(_WAVES).T
PROJECTION = BASIS.T * np.array([1.0] + [2.0] * 2 * HARMONICS)[:, None] / SAMPLES
COEFFICIENTS = len(PROJECTION)
_PROJECTED_BASIS = np.einsum("in,nj->nij", PROJECTION, BASIS).reshape(SAMPLES, -1)


def evaluate_at_harmonics(model: OpenPort, frequency: np.ndarray) -> OpenPort:
    """Let an open port be evaluated at s = 0 and at the harmonics of K frequencies (K,) in Hz.

    Its omega becomes (1 + HARMONICS K,).
    """
    harmonics = [2.0 * np.pi * h * frequency for h in range(1, HARMONICS + 1)]
    model.omega = np.concatenate([[-1j * SLOWEST], *harmonics])
    return model


@dataclass(frozen=True, eq=False)
class LinearPart:
    """The linear model beside its port, for C cells, with n = COEFFICIENTS r.

    Parameters
    ----------
    drive : ndarray
        (C, n) coefficients that the injected voltage causes at the port.
    back : ndarray
        (C, n, n) real, from the coefficients of w to those of z.
    y_u, y_w : ndarray
        (C, 2) and (C, 2, r) complex, from the injected voltage and from w to the current, per unit.
    amplitude : ndarray
        (C,) of the injection, per unit.
    """

    drive: np.ndarray
    back: np.ndarray
    y_u: np.ndarray
    y_w: np.ndarray
    amplitude: np.ndarray

    def select(self, cells: np.ndarray) -> "LinearPart":
        """Return some of the cells."""
        return LinearPart(
            self.drive[cells],
            self.back[cells],
            self.y_u[cells],
            self.y_w[cells],
            self.amplitude[cells],
        )


def build_linear_part(opened: OpenedModel, amplitude: np.ndarray) -> LinearPart:
    """Build the linear part of a model opened by `evaluate_at_harmonics` of K frequencies.

    amplitude : (K, M, L) of the injection, per unit.
    """
    count, points, levels = amplitude.shape
    r = opened.z_u.shape[-2]
    shape = (count, points, levels, 2)

    def repeat_for_cells(value: np.ndarray) -> np.ndarray:
        """Repeat (K, M, ...) for amplitudes and axes: (C, ...)."""
        spread = np.broadcast_to(value[:, :, None, None], (*shape, *value.shape[2:]))
        return spread.reshape(-1, *value.shape[2:])

    def columns_for_cells(value: np.ndarray) -> np.ndarray:
        """Take the column of each injected axis of (K, M, s, 2), for all amplitudes: (C, s)."""
        by_axis = np.moveaxis(value, -1, 2)
        spread = np.broadcast_to(by_axis[:, :, None], (*shape, by_axis.shape[-1]))
        return spread.reshape(-1, by_axis.shape[-1])

    cell_amplitude = np.broadcast_to(amplitude[..., None], shape).reshape(-1)
    fundamental = slice(1, 1 + count)
    z_u = columns_for_cells(opened.z_u[fundamental])
    y_u = columns_for_cells(opened.y_u[fundamental])
    y_w = repeat_for_cells(opened.y_w[fundamental])
    cells = len(cell_amplitude)
    drive = np.zeros((cells, r, COEFFICIENTS))
    drive[..., 1] = np.real(z_u) * cell_amplitude[:, None]
    drive[..., 2] = np.imag(z_u) * cell_amplitude[:, None]
    back = np.zeros((cells, r, COEFFICIENTS, r, COEFFICIENTS))
    at_zero = np.broadcast_to(np.real(opened.z_w[:1]), (count, *opened.z_w.shape[1:]))
    back[:, :, 0, :, 0] = repeat_for_cells(at_zero)
    for h in range(1, HARMONICS + 1):
        z_w = repeat_for_cells(opened.z_w[1 + (h - 1) * count : 1 + h * count])
        real = 2 * h - 1
        imaginary = 2 * h
        back[:, :, real, :, real] = back[:, :, imaginary, :, imaginary] = np.real(z_w)
        back[:, :, imaginary, :, real] = np.imag(z_w)
        back[:, :, real, :, imaginary] = -np.imag(z_w)
    n = r * COEFFICIENTS
    return LinearPart(drive.reshape(-1, n), back.reshape(-1, n, n), y_u, y_w, cell_amplitude)


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """Harmonics at the port that satisfy the balance.

    Parameters
    ----------
    entering, leaving : ndarray
        (C, r, COEFFICIENTS) of the deviation in front of the nonlinearity and behind it.
    slope : ndarray
        (C, n, n) derivative of the balance by `entering`.
    through : ndarray
        (C, n, n) derivative of `leaving` by `entering`.
    converged : ndarray
        (C,) whether a cell is balanced.
    """

    entering: np.ndarray
    leaving: np.ndarray
    slope: np.ndarray
    through: np.ndarray
    converged: np.ndarray


def solve_balance(
    linear: LinearPart,
    nonlinearity: Nonlinearity,
    steady: np.ndarray,
    threshold: float,
    start: np.ndarray | None = None,
) -> PeriodicMotion:
    """Solve the balance of all cells by Newton's method with step halving.

    Parameters
    ----------
    steady : ndarray
        (C, r) operating value at the port.
    threshold : float
        Per unit.
    start : ndarray or None
        (C, r, COEFFICIENTS) of `entering`. Cells that do not converge from there, or all without
        it, begin with linear motions in which a part of the signal passes, the nearest to a balance
        first.
    """
    cells = len(linear.drive)
    if not cells:
        raise ValueError("a balance needs at least one cell")
    motion = None
    unsolved = np.arange(cells)
    if start is not None:
        entering = start.reshape(cells, -1)
        motion = _iterate_newton(linear, nonlinearity, steady, threshold, entering)
        unsolved = np.flatnonzero(~motion.converged)
    if not len(unsolved):
        assert motion is not None
        return motion
    part = linear.select(unsolved)
    guesses = _linear_motions(part)
    errors = [
        _balance_error(part, nonlinearity, steady[unsolved], threshold, guess) for guess in guesses
    ]
    order = np.argsort(np.array(errors), axis=0)
    for rank in range(MOST_TRIED):
        nearest = guesses[order[rank], np.arange(len(unsolved))]
        solved = _iterate_newton(part, nonlinearity, steady[unsolved], threshold, nearest)
        motion = solved if motion is None else _replace_cells(motion, unsolved, solved)
        left = np.flatnonzero(~solved.converged)
        if not len(left):
            break
        part = part.select(left)
        unsolved = unsolved[left]
        guesses = guesses[:, left]
        order = order[:, left]
    assert motion is not None
    return motion


def _linear_motions(linear: LinearPart) -> np.ndarray:
    """Return the motions (G, C, n) in which the port passes each of G parts of the signal."""
    identity = np.eye(linear.drive.shape[1])
    return np.array(
        [
            np.linalg.solve(identity - gain * linear.back, linear.drive[..., None])[..., 0]
            for gain in INITIAL_GAINS
        ]
    )


def _replace_cells(
    motion: PeriodicMotion, cells: np.ndarray, others: PeriodicMotion
) -> PeriodicMotion:
    """Replace some cells of a motion by others where those are balanced."""
    better = cells[others.converged]
    fields = {name: value.copy() for name, value in vars(motion).items()}
    for name, value in fields.items():
        value[better] = getattr(others, name)[others.converged]
    return PeriodicMotion(**fields)


def _balance_error(
    linear: LinearPart,
    nonlinearity: Nonlinearity,
    steady: np.ndarray,
    threshold: float,
    z: np.ndarray,
) -> np.ndarray:
    """Return how far entering coefficients z (C, n) are from a balance, (C,)."""
    *_, residual = _balance(linear, nonlinearity, steady, threshold, z)
    return np.abs(residual / (1.0 + np.abs(linear.back).sum(axis=2))).max(axis=1)


def _balance(
    linear: LinearPart,
    nonlinearity: Nonlinearity,
    steady: np.ndarray,
    threshold: float,
    z: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate the balance at entering coefficients z (C, n).

    Returns
    -------
    tuple of ndarray
        Leaving coefficients (C, n), derivative of the nonlinearity (C, r, r, SAMPLES), and residual
        of the balance (C, n).
    """
    samples = z.reshape(len(z), steady.shape[1], COEFFICIENTS) @ BASIS.T
    output, derivative = nonlinearity.law(samples, steady[..., None], threshold)
    leaving = (output @ PROJECTION.T).reshape(len(z), -1)
    residual = z - linear.drive - np.einsum("cij,cj->ci", linear.back, leaving)
    return leaving, derivative, residual


def admittance_columns(linear: LinearPart, leaving: np.ndarray) -> np.ndarray:
    """Return the columns (C, 2) of the admittance of a motion, complex.

    leaving : (C, r, COEFFICIENTS).
    """
    w = leaving[..., 1] + 1j * leaving[..., 2]
    return linear.y_u + np.einsum("cij,cj->ci", linear.y_w, w) / linear.amplitude[:, None]


def extrapolate_leaving(before: PeriodicMotion, linear: LinearPart) -> np.ndarray:
    """Return `leaving` (C, r, COEFFICIENTS) in a slightly different model, by one Newton step.

    Exact to first order.
    """
    shape = before.entering.shape
    entering = before.entering.reshape(shape[0], -1)
    leaving = before.leaving.reshape(shape[0], -1)
    residual = entering - linear.drive - np.einsum("cij,cj->ci", linear.back, leaving)
    step = -np.linalg.solve(before.slope, residual[..., None])[..., 0]
    return (leaving + np.einsum("cij,cj->ci", before.through, step)).reshape(shape)


def _iterate_newton(
    linear: LinearPart,
    nonlinearity: Nonlinearity,
    steady: np.ndarray,
    threshold: float,
    z: np.ndarray,
) -> PeriodicMotion:
    """Iterate from entering coefficients z (C, n).

    Cells that are balanced stay while the others go on.
    """
    cells, r = steady.shape
    z = z.copy()
    scale = 1.0 / (1.0 + np.abs(linear.back).sum(axis=2))
    drive = np.maximum(np.abs(linear.drive).max(axis=1), LEAST_DRIVE)

    def evaluate(
        entering: np.ndarray, where: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return leaving coefficients, derivative, scaled residual and its size, of some cells."""
        leaving, derivative, residual = _balance(
            linear.select(where), nonlinearity, steady[where], threshold, entering
        )
        residual = scale[where] * residual
        return leaving, derivative, residual, np.abs(residual).max(axis=1) / drive[where]

    moving = np.arange(cells)
    _, derivative, residual, error = evaluate(z, moving)
    for _ in range(NEWTON_STEPS):
        goes_on = error >= CONVERGED
        if not goes_on.any():
            break
        moving = moving[goes_on]
        derivative = derivative[goes_on]
        residual = residual[goes_on]
        error = error[goes_on]
        slope = np.eye(z.shape[1]) - linear.back[moving] @ _coefficient_derivative(derivative)
        scaled_slope = scale[moving][..., None] * slope
        step = -np.linalg.solve(scaled_slope, residual[..., None])[..., 0]
        part = np.ones(len(moving))
        is_gain = evaluate(z[moving] + step, moving)[3] < error
        worse = np.flatnonzero(~is_gain)
        if len(worse):
            stuck = moving[worse]
            errors = [
                evaluate(z[stuck] + shorter * step[worse], stuck)[3] for shorter in SHORTER_STEPS
            ]
            part[worse] = np.array(SHORTER_STEPS)[np.argmin(errors, axis=0)]
        z[moving] += part[:, None] * step
        _, derivative, residual, error = evaluate(z[moving], moving)
    leaving, derivative, _, error = evaluate(z, np.arange(cells))
    through = _coefficient_derivative(derivative)
    return PeriodicMotion(
        entering=z.reshape(cells, r, COEFFICIENTS),
        leaving=leaving.reshape(cells, r, COEFFICIENTS),
        slope=np.eye(z.shape[1]) - linear.back @ through,
        through=through,
        converged=error < BALANCED,
    )


def _coefficient_derivative(derivative: np.ndarray) -> np.ndarray:
    """Return the derivative of leaving by entering coefficients, (C, n, n).

    derivative : (C, r, r, SAMPLES) of the nonlinearity at each sample.
    """
    cells, r = derivative.shape[:2]
    pairs = derivative.reshape(-1, SAMPLES) @ _PROJECTED_BASIS
    pairs = pairs.reshape(cells, r, r, COEFFICIENTS, COEFFICIENTS)
    return np.moveaxis(pairs, 2, 3).reshape(cells, r * COEFFICIENTS, r * COEFFICIENTS)
