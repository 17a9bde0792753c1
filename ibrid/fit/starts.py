"""Where a fit begins: textbook ranges, and what the top of the band says about the grid side of an
LCL filter.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ibrid.fit.problem import Problem
from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.structure.reading.wiring import PLANT, Wiring

#: Half width in decades of the two kinds of textbook start that alternate.
TEXTBOOK_DECADES = (1.0, 2.0)
#: Relative width of the start around a value read from the data.
SEED_SPREAD = {"L_g": 0.15, "C_F": 0.15, "R_g": 0.3}
#: Samples around the values read from the data, of which at least one must have a response.
SEED_SAMPLES = 8
#: Current |S| / v, per unit, above which an operating point is taken for mislabelled.
LARGEST_CURRENT = 2.0
#: Branches of an LCL filter without damping, whose grid side shows at the top of the band.
UNDAMPED = ((None, "C_F"),)


def high_frequency_seed(problem: Problem, omega_0: float) -> dict[str, float]:
    """R_g, L_g, C_F of an LCL filter from the top third of the band, a linear least-squares
    problem.

    -Y^-1 = R_g I + (L_g/omega_0) S + (omega_0/C_F) S^-1 with S = s I + omega_0 J, where the
    converter side is much larger than the capacitor; rows divided by |Y^-1|. Empty when the data do
    not give positive values.
    """
    j = np.array([[0.0, -1.0], [1.0, 0.0]])
    rows, right = [], []
    for point, data in zip(problem.points, problem.data, strict=True):
        omega = point.omega
        for k in range(len(omega) - max(2, len(omega) // 3), len(omega)):
            if k < 0 or abs(np.linalg.det(data[k])) < 1e-14 * np.abs(data[k]).max() ** 2:
                continue
            if (
                abs(omega[k] - omega_0) < 1e-6 * omega_0
            ):  # S is singular: the capacitor's sequence resonance at f0
                continue
            impedance = -np.linalg.inv(data[k])
            s = 1j * omega[k] * np.eye(2) + omega_0 * j
            columns = np.stack(
                [np.eye(2).ravel(), (s / omega_0).ravel(), (omega_0 * np.linalg.inv(s)).ravel()],
                axis=1,
            )
            scale = 1.0 / np.linalg.norm(impedance)
            rows.append(columns * scale)
            right.append(impedance.ravel() * scale)
    if not rows:
        return {}
    matrix, target = np.concatenate(rows), np.concatenate(right)
    stacked = np.concatenate([np.real(matrix), np.imag(matrix)])
    r_g, l_g, inverse_c = np.linalg.lstsq(
        stacked, np.concatenate([np.real(target), np.imag(target)]), rcond=None
    )[0]
    seed = {"R_g": r_g, "L_g": l_g, "C_F": 1.0 / inverse_c if inverse_c > 0 else -1.0}
    return {name: float(value) for name, value in seed.items() if value > 0}


class StartDrawer:
    """Sample starts x (S, P) of a problem: log-uniform around typical values, the grid side of an
    LCL filter around the values that the top of the band gives (`high_frequency_seed`).
    """

    def __init__(self, problem: Problem, wiring: Wiring, omega_0: float) -> None:
        self.problem = problem
        plant = wiring.kinds[wiring.plant]
        seed = (
            high_frequency_seed(problem, omega_0)
            if plant.branches == UNDAMPED and not wiring.outside
            else {}
        )
        if not all(
            plant.parameters[name].low <= value <= plant.parameters[name].high
            for name, value in seed.items()
        ):
            # read from too low a band, or in wrong units: it would exclude every operating point
            seed = {}
        members = [one.parameter.members[0] for one in problem.numbers]
        kinds = [wiring.kinds.get(instance) for instance, _ in members]
        self._seed = [
            (seed[parameter], SEED_SPREAD[parameter])
            if kind and kind.family == PLANT and parameter in seed
            else None
            for kind, (_, parameter) in zip(kinds, members, strict=True)
        ]
        names = [one.name for one in problem.numbers]
        self._inductance = (
            names.index(f"{wiring.plant}.L_F") if f"{wiring.plant}.L_F" in names else None
        )
        self._coupling = [  # (entry, factor): a decoupling gain starts at the filter inductance
            (index, 1.0 / omega_0 if kind.element is Element.COUPLING else 1.0)
            for index, kind in enumerate(kinds)
            if kind and kind.element in COUPLINGS and members[index][1] in kind.parameters
        ]
        if seed and not self._has_response_near_seed():
            self._seed = [None] * len(members)  # the resistance that was read carries no such power

    def _has_response_near_seed(self) -> bool:
        """Return True if a start near the values read from the data has a response.

        Also True if p, q and v give a current that no inverter carries: then they are to blame.
        """
        for point in self.problem.points:
            if np.hypot(point.op.p, point.op.q) > LARGEST_CURRENT * point.op.v:
                return True
        samples = self.draw(np.random.default_rng(0), SEED_SAMPLES, 1.0)
        costs = self.problem.costs(samples, "log").sum(axis=1)
        return bool(np.isfinite(costs).any())

    def draw(
        self, rng: np.random.Generator, number: int, decades: float, *, seeded: bool = True
    ) -> np.ndarray:
        """Sample `number` starts x (S, P) within +- `decades` of typical values.

        seeded : sample filter values around those read from the data, where there are any.
        """
        coordinates, numbers = self.problem.coordinates, self.problem.numbers
        theta = np.empty((number, len(numbers)))
        for index, one in enumerate(numbers):
            parameter, spread = one.parameter, rng.uniform(-1.0, 1.0, number)
            point = self.problem.points[one.point or 0].op
            if seeded and (seed := self._seed[index]) is not None:
                theta[:, index] = seed[0] * (1.0 + seed[1] * spread)
            elif parameter.tolerance is not None:
                theta[:, index] = parameter.typical * np.exp(parameter.tolerance * spread)
            elif parameter.name == "I0d":
                theta[:, index] = abs(point.p) * (1 + 0.15 * spread)
            elif parameter.name == "E0d":
                theta[:, index] = point.v * (1 + 0.05 * spread)
            elif parameter.name == "delta_eq":
                theta[:, index] = 0.15 * point.p + 0.1 * spread
            elif parameter.logarithmic:
                theta[:, index] = parameter.typical * 10.0 ** (decades * spread)
            elif coordinates.signed[index] and parameter.typical != 0:
                sign = np.where(rng.uniform(size=number) < 0.75, 1.0, -1.0)
                theta[:, index] = sign * parameter.typical * 10.0 ** (decades * spread)
            else:  # uniform in the coordinate of the search
                low, high = coordinates.x_low[index], coordinates.x_high[index]
                x = np.tile(coordinates.x_low, (number, 1))
                x[:, index] = low + (high - low) * (spread + 1) / 2
                theta[:, index] = coordinates.to_theta(x)[:, index]
        if self._inductance is not None:
            for index, factor in self._coupling:
                theta[:, index] = theta[:, self._inductance] * factor
        x = coordinates.to_x(np.clip(theta, coordinates.low, coordinates.high))
        return np.clip(x, coordinates.x_low, coordinates.x_high)

    def completed(
        self, rng: np.random.Generator, known: Sequence[Mapping[str, float]], number: int
    ) -> np.ndarray:
        """Return starts x (S, P) at known values, completed by samples of the missing parameters.

        known : "instance.parameter" -> physical value, one mapping for each operating point.
        number : S, of samples; a single start if nothing is missing.
        """
        coordinates = self.problem.coordinates
        values = [known[one.point or 0].get(one.name) for one in self.problem.numbers]
        given = np.array([value is not None for value in values], dtype=bool)
        theta = coordinates.to_theta(
            self.draw(rng, 1 if given.all() else number, TEXTBOOK_DECADES[0], seeded=False)
        )
        theta[:, given] = np.array([value for value in values if value is not None])
        return coordinates.to_x(np.clip(theta, coordinates.low, coordinates.high))
