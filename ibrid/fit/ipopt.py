"""The solver of record: Ipopt, through CasADi, on an objective with its gradient and a Gauss-Newton Hessian."""

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np

from ibrid.fit.problem import Misfit

#: The root is smoothed below this relative error, and no scale is smaller, so that an exact fit ends without line searches in
#: rounding errors.
_ROUNDING = 1e-7
#: Added to the Hessian of the scaled objective, so that a direction which changes no response is not stepped along.
_DAMPING = 1e-5

#: A number, and what gives its gradient (P,) and its Hessian (P, P): a line search asks for none.
Valued = tuple[float, Callable[[], tuple[np.ndarray, np.ndarray]]]
Objective = Callable[[np.ndarray], Valued]
Box = tuple[np.ndarray, np.ndarray]


def solve(misfit: Misfit, x: np.ndarray, *, iterations: int, seconds: float) -> tuple[np.ndarray, str, int]:
    """`minimise` the error from x, inside the boxes: where the noise is known the sum of the squares and of what is believed,
    which is the maximum likelihood; else the mean over operating points of the root of the squared error, as it is scored.
    """
    number = len(misfit.problem.points)

    def objective(x: np.ndarray) -> Valued:
        cost, gradient, hessian = (part[0] for part in misfit.parts(x[None]))
        if misfit.noise is None:
            root = np.sqrt(cost + _ROUNDING**2)
            value, factor = float(root.mean()), 1.0 / root / number
        else:
            value, factor = float(cost.sum()) / number, np.full(len(cost), 2.0 / number)
        return value, lambda: (factor @ gradient, np.einsum("m,mpq->pq", factor, hessian))

    return minimise(objective, misfit.box, x, iterations=iterations, seconds=seconds)


def minimise(
    objective: Objective, box: Box, x: np.ndarray, *, iterations: int, seconds: float, gain: float = 1e-7
) -> tuple[np.ndarray, str, int]:
    """x (P,) where an objective is least from x on, Ipopt's status, and its iterations; gain : relative, of the last steps."""
    (low, high), size = box, len(x)
    start = np.clip(x, low, high)
    memory = _Memory(objective, start)
    if not size or not np.isfinite(memory.scale):
        return start, "nothing to optimise", 0
    symbol = ca.MX.sym("x", size)
    callbacks = [_Value(memory, size), _Gradient(memory, size), _Hessian(memory, size)]
    solver = ca.nlpsol(
        "fit",
        "ipopt",
        {"x": symbol, "f": callbacks[0](symbol)},
        {
            "grad_f": callbacks[1],
            "hess_lag": callbacks[2],
            "no_nlp_grad": True,
            "calc_lam_p": False,
            "print_time": False,
            "show_eval_warnings": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": iterations,
            "ipopt.max_wall_time": max(seconds, 1e-3),
            "ipopt.tol": 1e-9,
            "ipopt.acceptable_tol": 1e10,  # so that a step without gain ends the solve
            "ipopt.acceptable_obj_change_tol": gain,
            "ipopt.acceptable_iter": 2,
            "ipopt.tiny_step_tol": 1e-8,  # of a logarithm: such a step is taken without a line search
            "ipopt.mu_init": 1e-9,
            "ipopt.bound_push": 1e-9,
            "ipopt.bound_frac": 1e-9,
            "ipopt.bound_relax_factor": 0.0,
        },
    )
    answer = solver(x0=start, lbx=low, ubx=high)
    if memory.interruption is not None:
        raise memory.interruption
    statistics = solver.stats()
    found = np.clip(np.asarray(answer["x"]).ravel(), low, high)
    if not memory.value(found) <= memory.value(start):
        found = start
    return found, str(statistics["return_status"]), int(statistics["iter_count"])


class _Memory:
    """One evaluation serves value, gradient and Hessian; the error is scaled to 1 at the start."""

    def __init__(self, objective: Objective, start: np.ndarray) -> None:
        self.objective = objective
        self._key: bytes | None = None
        self.interruption: TimeoutError | KeyboardInterrupt | None = None
        self.scale = 1.0
        self.scale = max(self.value(start), _ROUNDING)

    def value(self, x: np.ndarray) -> float:
        if (key := x.tobytes()) != self._key:
            self._value, slopes = self.objective(x)
            flat = (np.zeros(len(x)), np.eye(len(x)))
            self._key, self._slopes = key, cache(slopes if np.isfinite(self._value) else lambda: flat)
        return self._value / self.scale

    def gradient(self, x: np.ndarray) -> np.ndarray:
        self.value(x)
        return self._slopes()[0] / self.scale

    def hessian(self, x: np.ndarray) -> np.ndarray:
        self.value(x)
        return self._slopes()[1] / self.scale


class _Value(ca.Callback):
    """The objective as CasADi calls it; gradient and Hessian differ in their ports and in what they evaluate."""

    inputs: tuple[str, ...] = ("x",)
    outputs: tuple[str, ...] = ("f",)
    output = "f"

    def __init__(self, memory: _Memory, size: int) -> None:
        ca.Callback.__init__(self)
        self.memory, self.size = memory, size
        self.construct(self.output, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_name_in(self, index: int) -> str:
        return self.inputs[index]

    def get_name_out(self, index: int) -> str:
        return self.outputs[index]

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        name = self.inputs[index]
        if name == "x":
            return ca.Sparsity.dense(self.size, 1)
        return ca.Sparsity.dense(1, 1) if name == "lam_f" else ca.Sparsity(0, 0)

    def eval(self, arguments):
        """CasADi would print what is raised in here and go on; not a number makes Ipopt stop instead."""
        if self.memory.interruption is None:
            try:
                return self.evaluated(arguments)
            except (TimeoutError, KeyboardInterrupt) as interruption:
                self.memory.interruption = interruption
        return [ca.DM(self.get_sparsity_out(index), np.nan) for index in range(self.get_n_out())]

    def evaluated(self, arguments):
        return [self.memory.value(self.vector(arguments[0]))]

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        return ca.Sparsity.dense(1, 1)

    @staticmethod
    def vector(argument: ca.DM) -> np.ndarray:
        return np.asarray(argument, dtype=float).ravel()


class _Gradient(_Value):
    inputs = ("x", "p")
    outputs = ("f", "grad_f_x")
    output = "grad_f"

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        return ca.Sparsity.dense(1, 1) if index == 0 else ca.Sparsity.dense(self.size, 1)

    def evaluated(self, arguments):
        x = self.vector(arguments[0])
        return [self.memory.value(x), ca.DM(self.memory.gradient(x))]


class _Hessian(_Value):
    inputs = ("x", "p", "lam_f", "lam_g")
    outputs = ("hess",)
    output = "hess_lag"

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        return ca.Sparsity.upper(self.size)

    def evaluated(self, arguments):
        hessian = self.memory.hessian(self.vector(arguments[0])) + _DAMPING * np.eye(self.size)
        hessian = hessian * float(arguments[2])
        return [ca.project(ca.DM(hessian), ca.Sparsity.upper(self.size))]
