"""How long a whole evaluation takes, beside scipy.optimize.least_squares on python-control
responses; cost by size.
"""

import statistics
import time
from collections.abc import Callable

import control
import numpy as np
from ibrid_bench.fit.devices import of_order
from scipy.optimize import least_squares

from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numeric import closed_loop
from ibrid.assembly.symbolic import symbolic_matrices, symbolic_model
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.fit.problem import Problem
from ibrid.fit.starts import StartDrawer
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import wire


def median_seconds(run: Callable[[], object], times: int) -> float:
    """Median wall time of a call."""
    found = []
    for _ in range(times):
        started = time.perf_counter()
        run()
        found.append(time.perf_counter() - started)
    return statistics.median(found)


def evaluation_seconds(diagram: Diagram, sweep: Sweep, seeds: int) -> tuple[float, float]:
    """Median seconds of a whole evaluation over seeds, and the worst NRMSE."""
    evaluate(diagram, sweep)  # compiled code is loaded
    records = [evaluate(diagram, sweep, seed=seed) for seed in range(seeds)]
    return statistics.median(record.seconds for record in records), max(
        np.inf if record.nrmse is None else record.nrmse for record in records
    )


def reference_seconds(
    diagram: Diagram, sweep: Sweep, *, starts: int = 6, by_interconnect: bool
) -> tuple[float, float, int]:
    """Seconds, best NRMSE and responses taken by least_squares (TRF, logarithmic parameters,
    two-point differences).

    by_interconnect : the matrices of every trial come from python-control's interconnect; otherwise
    from our compiled
        CasADi functions, which spares the alternative its slowest part.
    """
    started = time.perf_counter()
    wiring = wire(diagram, VOCABULARY)
    physics = {"equilibrium": "exact", "power_node": sweep.power_node, "omega_0": sweep.omega_0}
    table = parameter_table(wiring, "exact")
    compiled = symbolic_matrices(wiring, {}, **physics)
    problem = Problem(symbolic_model(wiring, **physics), sweep.points)
    coordinates, responses = problem.coordinates, 0

    def system(theta: np.ndarray, point: PointSweep) -> control.StateSpace:
        at = (point.op.p, point.op.q, point.op.v)
        if by_interconnect:
            values = dict(zip(table.names, map(float, theta), strict=True))
            return closed_loop(
                wiring, module_matrices(wiring, parameters_at(wiring, table, values), at, **physics)
            )
        return control.StateSpace(*(np.array(part) for part in compiled(theta, at)))

    def residual(x: np.ndarray) -> np.ndarray:
        nonlocal responses
        theta, rows = coordinates.to_theta(x), []
        for point in sweep.points:
            responses += 1
            try:
                response = system(theta, point).frequency_response(point.omega).frdata
            except IbridError:  # no operating point there
                response = np.full((2, 2, len(point.frequency)), 1e3)
            error = (np.moveaxis(response, 2, 0) - point.admittance) / np.linalg.norm(
                point.admittance
            )
            rows += [error.real.ravel(), error.imag.ravel()]
        return np.nan_to_num(np.concatenate(rows), nan=1e3, posinf=1e3, neginf=-1e3)

    drawn = StartDrawer(problem, wiring, sweep.omega_0).draw(np.random.default_rng(0), starts, 1.0)
    best = np.inf
    for x in drawn:
        answer = least_squares(
            residual, x, bounds=(coordinates.x_low, coordinates.x_high), max_nfev=150
        )
        best = min(best, float(np.sqrt(2 * answer.cost / len(sweep.points))))
    return time.perf_counter() - started, best, responses


def cost_by_size(orders: tuple[int, ...], counts: tuple[int, ...]) -> dict[tuple[int, int], float]:
    """(states, frequencies) -> seconds of residual, gradient and J'J per start at two operating
    points.
    """
    found = {}
    for order in orders:
        model = symbolic_model(
            wire(of_order(order), VOCABULARY),
            equilibrium="exact",
            power_node="capacitor",
            omega_0=2 * np.pi * 60,
        )
        for count in counts:
            frequency = np.geomspace(5.0, 5000.0, count)
            points = [
                PointSweep(
                    OperatingPoint(f"q={q}", 1.0, q),
                    frequency,
                    np.ones((count, 2, 2), dtype=complex),
                )
                for q in (0.3, -0.3)
            ]
            problem = Problem(model, points)
            typical = np.array([one.parameter.typical for one in problem.numbers])
            x = np.tile(problem.coordinates.to_x(typical), (8, 1))
            problem.normal_equations(x, "nrmse")
            found[order, count] = median_seconds(
                lambda p=problem, at=x: p.normal_equations(at, "nrmse"), 15
            ) / len(x)
    return found
