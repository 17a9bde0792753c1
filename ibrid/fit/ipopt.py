"""The solver of record: Ipopt, through CasADi, on the compiled objective with exact gradient and Gauss-Newton Hessian."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ibrid.fit.problem import Misfit

#: The root is smoothed below this relative error, and no scale is smaller, so that an exact fit ends without line searches in
#: rounding errors.
_ROUNDING = 1e-7
#: Added to the Hessian of the scaled objective, so that a direction which changes no response is not stepped along.
_DAMPING = 1e-5


@dataclass(frozen=True)
class Optimum:
    """Ipopt's answer: x (P,), the squared errors (M,), its status, the number of iterations."""

    x: np.ndarray
    costs: np.ndarray
    status: str
    iterations: int


def solve(misfit: Misfit, x: np.ndarray, *, iterations: int, seconds: float) -> Optimum:
    """Minimise the error from x, inside the boxes: where the noise is known the sum of the squares and of what is believed, which
    is the maximum likelihood; else the mean over operating points of the root of the squared error, as it is scored.
    """
    (low, high), size = misfit.box, misfit.problem.size
    start = np.clip(x, low, high)
    memory = _Memory(misfit, start)
    if not size or not np.isfinite(memory.scale):
        return Optimum(start, memory.costs(start), "nothing to optimise", 0)
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
            "ipopt.acceptable_obj_change_tol": 1e-7,
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
    return Optimum(found, memory.costs(found), str(statistics["return_status"]), int(statistics["iter_count"]))


class _Memory:
    """One evaluation serves value, gradient and Hessian; the error is scaled to 1 at the start."""

    def __init__(self, misfit: Misfit, start: np.ndarray) -> None:
        self.misfit = misfit
        self._key: bytes | None = None
        self._result: tuple[float, np.ndarray, np.ndarray] = (np.inf, np.zeros(0), np.zeros(0))
        self._costs = np.zeros(0)
        self.interruption: TimeoutError | KeyboardInterrupt | None = None
        self.scale = 1.0
        self._evaluate(start)
        self.scale = max(self._result[0], _ROUNDING)
        self._key = None  # what is kept of the start is not scaled

    def _evaluate(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        if (key := x.tobytes()) != self._key:
            cost, gradient, hessian = self.misfit.parts(x[None])
            number, size = len(self.misfit.problem.points), len(x)
            if self.misfit.noise is None:
                root = np.sqrt(cost[0] + _ROUNDING**2)
                value, factor = float(root.mean()) / self.scale, 1.0 / root / number / self.scale
            else:
                value = float(cost[0].sum()) / number / self.scale
                factor = np.full(cost.shape[1], 2.0 / number / self.scale)
            total = np.einsum("m,mp->p", factor, gradient[0]) if np.isfinite(value) else np.zeros(size)
            curvature = np.einsum("m,mpq->pq", factor, hessian[0]) if np.isfinite(value) else np.eye(size)
            self._key, self._costs, self._result = key, cost[0, :number], (value, total, curvature)
        return self._result

    def value(self, x: np.ndarray) -> float:
        return self._evaluate(x)[0]

    def gradient(self, x: np.ndarray) -> np.ndarray:
        return self._evaluate(x)[1]

    def hessian(self, x: np.ndarray) -> np.ndarray:
        return self._evaluate(x)[2]

    def costs(self, x: np.ndarray) -> np.ndarray:
        self._evaluate(x)
        return self._costs


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
