"""The solver of record: Ipopt, through CasADi, on an objective with its gradient and a Gauss-Newton
Hessian.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from ibrid.fit.problem import Misfit
from ibrid.interrupts import heed_interrupt, was_interrupted

#: The root is smoothed below this relative error, and no scale is smaller, so that an exact fit
#: ends without line searches in rounding errors.
_ROUNDING = 1e-7
#: Added to the Hessian of the scaled objective, so that a direction which changes no response is
#: not stepped along.
_DAMPING = 1e-5

#: A number, and what gives its gradient (P,) and its Hessian (P, P): a line search asks for none.
Valued = tuple[float, Callable[[], tuple[np.ndarray, np.ndarray]]]
Objective = Callable[[np.ndarray], Valued]
Box = tuple[np.ndarray, np.ndarray]


def solve(misfit: Misfit, x: np.ndarray, *, iterations: int) -> tuple[np.ndarray, str, int]:
    """`minimise` the error from x, inside the boxes: where the noise is known the sum of the
    squares and of what is believed, which is the maximum likelihood; else the mean over operating
    points of the root of the squared error, as it is scored.
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

    return minimise(objective, misfit.box, x, iterations=iterations)


def minimise(
    objective: Objective, box: Box, x: np.ndarray, *, iterations: int, gain: float = 1e-7
) -> tuple[np.ndarray, str, int]:
    """x (P,) where an objective is least from x on, Ipopt's status, and its iterations; gain :
    relative, of the last steps.
    """
    (low, high), size = box, len(x)
    start = np.clip(x, low, high)
    memory = _LastPoint(objective, start)
    if not size or not np.isfinite(memory.scale):
        return start, "nothing to optimise", 0
    symbol = ca.MX.sym("x", size)
    x_shape, number, nothing = (
        ca.Sparsity.dense(size, 1),
        ca.Sparsity.dense(1, 1),
        ca.Sparsity(0, 0),
    )
    given, upper = {"x": x_shape, "p": nothing}, ca.Sparsity.upper(size)

    def slopes(x: np.ndarray, p: np.ndarray) -> list[Any]:
        return [memory.value(x), ca.DM(memory.gradient(x))]

    def curvature(x: np.ndarray, p: np.ndarray, lam_f: np.ndarray, lam_g: np.ndarray) -> list[Any]:
        hessian = (memory.hessian(x) + _DAMPING * np.eye(size)) * float(lam_f[0])
        return [ca.project(ca.DM(hessian), upper)]

    callbacks = [
        _Callback(memory, "f", {"x": x_shape}, {"f": number}, lambda x: [memory.value(x)]),
        _Callback(memory, "grad_f", given, {"f": number, "grad_f_x": x_shape}, slopes),
        _Callback(
            memory,
            "hess_lag",
            {**given, "lam_f": number, "lam_g": nothing},
            {"hess": upper},
            curvature,
        ),
    ]
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
            "ipopt.option_file_name": "",  # none: the working folder may be somebody else's
            "ipopt.max_iter": iterations,
            "ipopt.tol": 1e-9,
            "ipopt.acceptable_tol": 1e10,  # so that a step without gain ends the solve
            "ipopt.acceptable_obj_change_tol": gain,
            "ipopt.acceptable_iter": 2,
            # of a logarithm: such a step is taken without a line search
            "ipopt.tiny_step_tol": 1e-8,
            "ipopt.mu_init": 1e-9,
            "ipopt.bound_push": 1e-9,
            "ipopt.bound_frac": 1e-9,
            "ipopt.bound_relax_factor": 0.0,
        },
    )
    answer = solver(x0=start, lbx=low, ubx=high)
    heed_interrupt()
    if memory.interruption is not None:
        raise memory.interruption
    statistics = solver.stats()
    found = np.clip(np.asarray(answer["x"]).ravel(), low, high)
    if not memory.value(found) <= memory.value(start):
        found = start
    return found, str(statistics["return_status"]), int(statistics["iter_count"])


class _LastPoint:
    """One evaluation serves value, gradient and Hessian; the error is scaled to 1 at the start."""

    def __init__(self, objective: Objective, start: np.ndarray) -> None:
        self.objective = objective
        self._key: bytes | None = None
        self.interruption: KeyboardInterrupt | None = None
        self.scale = 1.0
        self.scale = max(self.value(start), _ROUNDING)

    def value(self, x: np.ndarray) -> float:
        if (key := x.tobytes()) != self._key:
            self._value, slopes = self.objective(x)
            flat = (np.zeros(len(x)), np.eye(len(x)))
            self._key, self._slopes = (
                key,
                cache(slopes if np.isfinite(self._value) else lambda: flat),
            )
        return self._value / self.scale

    def gradient(self, x: np.ndarray) -> np.ndarray:
        self.value(x)
        return self._slopes()[0] / self.scale

    def hessian(self, x: np.ndarray) -> np.ndarray:
        self.value(x)
        return self._slopes()[1] / self.scale


class _Callback(ca.Callback):
    """A function as CasADi calls it.

    inputs, outputs : name -> sparsity. evaluated : outputs at the arguments as vectors.
    """

    def __init__(
        self,
        memory: _LastPoint,
        name: str,
        inputs: Mapping[str, ca.Sparsity],
        outputs: Mapping[str, ca.Sparsity],
        evaluated: Callable[..., list[Any]],
    ) -> None:
        ca.Callback.__init__(self)
        self.memory, self.evaluated = memory, evaluated
        self.inputs, self.outputs = list(inputs.items()), list(outputs.items())
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_name_in(self, index: int) -> str:
        return self.inputs[index][0]

    def get_name_out(self, index: int) -> str:
        return self.outputs[index][0]

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        return self.inputs[index][1]

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        return self.outputs[index][1]

    def eval(self, arguments):
        """CasADi would print what is raised in here and go on; not a number makes Ipopt stop
        instead.
        """
        if self.memory.interruption is None:
            try:
                return self.evaluated(*(np.asarray(one, dtype=float).ravel() for one in arguments))
            except KeyboardInterrupt as interruption:
                self.memory.interruption = interruption
            except SystemError:  # of a function that was compiled while the interrupt arrived
                if not was_interrupted():
                    raise
                self.memory.interruption = KeyboardInterrupt()
        return [ca.DM(sparsity, np.nan) for _, sparsity in self.outputs]
