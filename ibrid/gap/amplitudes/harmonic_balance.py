"""The periodic motion of a linear model with one nonlinearity at a port, by harmonic balance.

The port of an opened model sees z = Z_u v + Z_w w. With a memoryless w = F(z) instead of w = z, the
harmonics of z obey z_h = Z_u v (h = 1) + Z_w(j h omega) w_h for h = 0 .. HARMONICS. With the first
alone this is the method of describing functions, the gain N(A) depending on the amplitude at the
port that it sets itself; h = 0 is the shift of the mean, which integrating loops hold, and the
others are what the port feeds back of its own distortion.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.gap.amplitudes.nonlinearities import Shape
from ibrid.gap.ports.open_port import OpenedModel, OpenPort

#: Harmonics beside the mean, and samples of a period.
HARMONICS, SAMPLES = 3, 96
#: rad/s, real: stands for s = 0, where integrators have no response; on the imaginary axis theirs
#: would be imaginary.
SLOWEST = 1e-3
#: Steps of Newton's method, parts of a step that are tried where the whole one is no gain, what is
#: left over (of the drive) that ends them, and that still counts as balanced.
STEPS, PARTS, CONVERGED, BALANCED = 20, (0.5, 0.25, 0.1, 0.03), 1e-9, 1e-4
#: Parts of the signal that a nonlinearity is taken to let through where a search begins, and how
#: many of them are tried.
THROUGH, TRIED = tuple(np.linspace(0.0, 1.0, 21)), 4

_PHASE = 2.0 * np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES
_WAVES = [np.ones(SAMPLES)]
for _h in range(1, HARMONICS + 1):
    _WAVES += [np.cos(_h * _PHASE), -np.sin(_h * _PHASE)]
#: Coefficients (mean, real and imaginary part of each harmonic) -> samples, and back.
BASIS = np.array(_WAVES).T
PROJECTION = BASIS.T * np.array([1.0] + [2.0] * 2 * HARMONICS)[:, None] / SAMPLES
COEFFICIENTS = len(PROJECTION)
_TWICE = np.einsum("in,nj->nij", PROJECTION, BASIS).reshape(SAMPLES, -1)


def evaluate_at_harmonics(model: OpenPort, frequency: np.ndarray) -> OpenPort:
    """The same open port, from now on evaluated at s = 0 and at the harmonics of K frequencies (K,)
    Hz: 1 + HARMONICS K.
    """
    harmonics = [2.0 * np.pi * h * frequency for h in range(1, HARMONICS + 1)]
    model.omega = np.concatenate([[-1j * SLOWEST], *harmonics])
    return model


@dataclass(frozen=True, eq=False)
class LinearPart:
    """What a model does beside its port for C = K M L 2 cells (frequency, point, amplitude, axis).

    `drive` : (C, n) of the injected voltage on the port, n = COEFFICIENTS r. `back` : (C, n, n)
    real, from w to z. `y_u` : (C, 2), `y_w` : (C, 2, r) complex, per unit of injection. `amplitude`
    : (C,).
    """

    drive: np.ndarray
    back: np.ndarray
    y_u: np.ndarray
    y_w: np.ndarray
    amplitude: np.ndarray

    def select(self, cells: np.ndarray) -> "LinearPart":
        """Some of the cells."""
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

    def cells(value: np.ndarray) -> np.ndarray:
        """(K, M, ...) for each cell."""
        spread = np.broadcast_to(value[:, :, None, None], (*shape, *value.shape[2:]))
        return spread.reshape(-1, *value.shape[2:])

    size = np.broadcast_to(amplitude[..., None], shape).reshape(-1)
    first = slice(1, 1 + count)
    z_u, y_u = (
        np.moveaxis(one[first], -1, 2) for one in (opened.z_u, opened.y_u)
    )  # the axis of injection third
    z_u, y_u = (
        np.broadcast_to(one[:, :, None], (*shape, one.shape[-1])).reshape(-1, one.shape[-1])
        for one in (z_u, y_u)
    )
    drive = np.zeros((len(size), r, COEFFICIENTS))
    drive[..., 1], drive[..., 2] = np.real(z_u) * size[:, None], np.imag(z_u) * size[:, None]
    back = np.zeros((len(size), r, COEFFICIENTS, r, COEFFICIENTS))
    back[:, :, 0, :, 0] = cells(
        np.broadcast_to(np.real(opened.z_w[:1]), (count, *opened.z_w.shape[1:]))
    )
    for h in range(1, HARMONICS + 1):
        z_w = cells(opened.z_w[1 + (h - 1) * count : 1 + h * count])
        real, imaginary = 2 * h - 1, 2 * h
        back[:, :, real, :, real] = back[:, :, imaginary, :, imaginary] = np.real(z_w)
        back[:, :, imaginary, :, real], back[:, :, real, :, imaginary] = np.imag(z_w), -np.imag(z_w)
    n = r * COEFFICIENTS
    return LinearPart(
        drive.reshape(-1, n), back.reshape(-1, n, n), y_u, cells(opened.y_w[first]), size
    )


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """A balanced motion. `entering`, `leaving` : (C, r, COEFFICIENTS) of the port's deviation
    before and behind it.
    `slope` : (C, n, n) of the balance by `entering`. `through` : (C, n, n), of `leaving` by
    `entering`. `converged` : (C,).
    """

    entering: np.ndarray
    leaving: np.ndarray
    slope: np.ndarray
    through: np.ndarray
    converged: np.ndarray


def solve_balance(
    linear: LinearPart,
    shape: Shape,
    rest: np.ndarray,
    threshold: float,
    start: np.ndarray | None = None,
) -> PeriodicMotion:
    """Solve the balance of all cells by Newton's method, with shorter steps where whole ones do not
    help.

    rest : (C, r), the port's value at rest. start : (C, r, COEFFICIENTS) of `entering`; where that
    does not lead to a balance, or is None, motions with a part of the signal let through are begun
    from, the nearest to a balance first.
    """
    cells, n = linear.drive.shape
    if start is None:
        motion, lost = None, np.arange(cells)
    else:
        motion = _iterate_newton(linear, shape, rest, threshold, start.reshape(cells, -1))
        lost = np.flatnonzero(~motion.converged)
    if not len(lost):
        return (
            motion
            if motion is not None
            else _iterate_newton(linear, shape, rest, threshold, linear.drive)
        )
    part = linear.select(lost)
    guesses = np.array(
        [np.linalg.solve(np.eye(n) - g * part.back, part.drive[..., None])[..., 0] for g in THROUGH]
    )
    errors = np.array([_balance_error(part, shape, rest[lost], threshold, one) for one in guesses])
    order = np.argsort(errors, axis=0)
    for guess in range(TRIED):
        begun = guesses[order[guess], np.arange(len(lost))]
        found = _iterate_newton(part, shape, rest[lost], threshold, begun)
        motion = found if motion is None else _replace_cells(motion, lost, found)
        left = np.flatnonzero(~found.converged)
        if not len(left):
            break
        part, lost, guesses, order = part.select(left), lost[left], guesses[:, left], order[:, left]
    if motion is None:
        raise ValueError("a balance needs at least one cell")
    return motion


def _replace_cells(
    motion: PeriodicMotion, where: np.ndarray, others: PeriodicMotion
) -> PeriodicMotion:
    """A motion with some cells exchanged for others where those are balanced."""
    better = where[others.converged]
    fields = {name: value.copy() for name, value in vars(motion).items()}
    for name, value in fields.items():
        value[better] = getattr(others, name)[others.converged]
    return PeriodicMotion(**fields)


def _balance_error(
    linear: LinearPart, shape: Shape, rest: np.ndarray, threshold: float, z: np.ndarray
) -> np.ndarray:
    """(C,) how far entering coefficients (C, n) are from a balance, over the signal behind the port
    without it.
    """
    *_, left = _balance(linear, shape, rest, threshold, z)
    return np.abs(left / (1.0 + np.abs(linear.back).sum(axis=2))).max(axis=1)


def _balance(
    linear: LinearPart, shape: Shape, rest: np.ndarray, threshold: float, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of entering coefficients (C, n): the leaving ones, the slopes of the law, and what the
    balance leaves over.
    """
    samples = z.reshape(len(z), rest.shape[1], COEFFICIENTS) @ BASIS.T
    behind, slopes = shape.law(samples, rest[..., None], threshold)
    leaving = (behind @ PROJECTION.T).reshape(len(z), -1)
    return leaving, slopes, z - linear.drive - np.einsum("cij,cj->ci", linear.back, leaving)


def response(linear: LinearPart, leaving: np.ndarray) -> np.ndarray:
    """(C, 2) complex: the column of Y that a motion means. leaving : (C, r, COEFFICIENTS)."""
    w = leaving[..., 1] + 1j * leaving[..., 2]
    return linear.y_u + np.einsum("cij,cj->ci", linear.y_w, w) / linear.amplitude[:, None]


def extrapolate_leaving(before: PeriodicMotion, linear: LinearPart) -> np.ndarray:
    """`leaving` (C, r, COEFFICIENTS) after one step of Newton's method in a slightly different
    model; exact to first order.
    """
    shape = before.entering.shape
    entering, leaving = before.entering.reshape(shape[0], -1), before.leaving.reshape(shape[0], -1)
    left = entering - linear.drive - np.einsum("cij,cj->ci", linear.back, leaving)
    step = -np.linalg.solve(before.slope, left[..., None])[..., 0]
    return (leaving + np.einsum("cij,cj->ci", before.through, step)).reshape(shape)


def _iterate_newton(
    linear: LinearPart, shape: Shape, rest: np.ndarray, threshold: float, z: np.ndarray
) -> PeriodicMotion:
    """From entering coefficients z (C, n); cells that are balanced, or cannot be, rest while the
    others go on.
    """
    cells, r = rest.shape
    z = z.copy()
    scale = 1.0 / (1.0 + np.abs(linear.back).sum(axis=2))
    size = np.maximum(np.abs(linear.drive).max(axis=1), 1e-12)

    def at(
        entering: np.ndarray, where: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of some cells: leaving coefficients, slopes, what the balance leaves over, and how much
        that is.
        """
        leaving, slopes, left = _balance(
            linear.select(where), shape, rest[where], threshold, entering
        )
        left = scale[where] * left
        return leaving, slopes, left, np.abs(left).max(axis=1) / size[where]

    moving = np.arange(cells)
    _, slopes, left, error = at(z, moving)
    for _ in range(STEPS):
        going = error >= CONVERGED
        if not going.any():
            break
        moving, slopes, left, error = moving[going], slopes[going], left[going], error[going]
        slope = np.eye(z.shape[1]) - linear.back[moving] @ _transfer_slopes(slopes)
        step = -np.linalg.solve(scale[moving][..., None] * slope, left[..., None])[..., 0]
        part = np.ones(len(moving))
        worse = np.flatnonzero(~(at(z[moving] + step, moving)[3] < error))
        if len(worse):
            tried = [at(z[moving[worse]] + one * step[worse], moving[worse])[3] for one in PARTS]
            part[worse] = np.array(PARTS)[np.argmin(tried, axis=0)]
        z[moving] += part[:, None] * step
        _, slopes, left, error = at(z[moving], moving)
    leaving, slopes, _, error = at(z, np.arange(cells))
    through = _transfer_slopes(slopes)
    return PeriodicMotion(
        entering=z.reshape(cells, r, COEFFICIENTS),
        leaving=leaving.reshape(cells, r, COEFFICIENTS),
        slope=np.eye(z.shape[1]) - linear.back @ through,
        through=through,
        converged=error < BALANCED,
    )


def _transfer_slopes(slopes: np.ndarray) -> np.ndarray:
    """(C, n, n) from coefficients to coefficients, of slopes (C, r, r, SAMPLES)."""
    cells, r = slopes.shape[:2]
    pairs = (slopes.reshape(-1, SAMPLES) @ _TWICE).reshape(cells, r, r, COEFFICIENTS, COEFFICIENTS)
    return np.moveaxis(pairs, 2, 3).reshape(cells, r * COEFFICIENTS, r * COEFFICIENTS)
