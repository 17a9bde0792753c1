"""Problems and records that several tests share."""

from dataclasses import replace

import numpy as np
from sharing import shared

import ibrid
from ibrid.assembly.symbolic import symbolic_model
from ibrid.evaluation.record import Record
from ibrid.fit.problem import Problem
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants import PLANTS, frequency_grid, operating_point, state_space
from ibrid.structure.compiling.compiled import compile_diagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.wiring import Wiring

GRID = frequency_grid("5:5000:16")
TRUE = PLANTS["paper_like"].diagram_values


@shared
def benchmark() -> Sweep:
    """The benchmark's sweep."""
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


@shared
def evaluated(name: str, **options) -> Record:
    """A textbook diagram fitted to the benchmark."""
    return ibrid.evaluate(ibrid.textbook(name), benchmark(), **options)


def measured(texts: list[str], plant: str = "paper_like", frequency: np.ndarray = GRID) -> Sweep:
    """The linearised admittance of a plant at operating points, stable or not."""
    inverter = PLANTS[plant]
    points = [operating_point(text) for text in texts]
    return Sweep(
        tuple(
            PointSweep(op, frequency, state_space(inverter, op).admittance(frequency))
            for op in points
        ),
        f0_hz=inverter.f0_hz,
        power_node=inverter.power_node,
    )


def changed(sweep: Sweep, admittance=None, op=None, kept=None) -> Sweep:
    """A sweep with other admittances (a function of (K, 2, 2)), operating points (of one), or rows
    (of its number).
    """
    points = []
    for number, point in enumerate(sweep.points):
        rows = slice(None) if kept is None else kept(number)
        values = point.admittance if admittance is None else admittance(np.array(point.admittance))
        points.append(
            PointSweep(op(point.op) if op else point.op, point.frequency[rows], values[rows])
        )
    return replace(sweep, points=tuple(points))


def problem_of(
    diagram: Diagram, sweep: Sweep, equilibrium: str = "exact"
) -> tuple[Problem, Wiring]:
    """The fitting problem that `evaluate` solves with shared parameters."""
    wiring = compile_diagram(diagram, VOCABULARY, equilibrium=equilibrium).canonical_wiring
    model = symbolic_model(
        wiring, equilibrium=equilibrium, power_node=sweep.power_node, omega_0=sweep.omega_0
    )
    return Problem(model, sweep.points), wiring


def x_of(problem: Problem, values) -> np.ndarray:
    """Search coordinates of values by name, of a shared fit."""
    return problem.coordinates.to_x(np.array([values[one.name] for one in problem.numbers]))


def drawn(
    problem: Problem, rng: np.random.Generator, number: int = 1, decades: float = 0.5
) -> np.ndarray:
    """Random x (S, P) around typical values, inside the boxes."""
    coordinates = problem.coordinates
    typical = coordinates.to_x(np.array([one.parameter.typical for one in problem.numbers]))
    x = typical + rng.uniform(-1, 1, (number, problem.size)) * decades * np.log(10) / 2
    return np.clip(x, coordinates.x_low + 1e-3, coordinates.x_high - 1e-3)


def objective_value(problem: Problem, x: np.ndarray, objective: str) -> float:
    """What a fit minimises: the mean over operating points of the root of the squared error."""
    return float(np.sqrt(problem.costs(x[None], objective)[0]).mean())
