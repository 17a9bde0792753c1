"""A hidden inverter: a program with its true values, and the sweep that a measurement of exactly
that would give.

The search sees the sweep alone. Its proposers, archive and loop never import anything from
search/ibrid_bench.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, PowerNode, Sweep
from ibrid.modules.delay import pade_order
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.reference import P1_Q03
from ibrid.plants.sweeping import frequency_grid
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import wire

FREQUENCY = frequency_grid("5:5000:16")
HALF_LOAD = OperatingPoint("p=0.5,q=0", 0.5, 0.0)


@dataclass(frozen=True, eq=False)
class Hidden:
    """An inverter to be found.

    `name`, `summary` : for the tables. `sweep` : all that the search gets to see. `program` : text
    of the true diagram, "" for hardware. `values` : its true parameters, keyed
    "instance.parameter"; per unit, s, rad/s. `held_out` : one operating point that is never fitted,
    clean; None where nobody measured one.
    """

    name: str
    summary: str
    sweep: Sweep
    program: str = ""
    values: Mapping[str, float] | None = None
    held_out: Sweep | None = None

    @property
    def truth(self) -> Diagram | None:
        """The true diagram; None for hardware."""
        return parse_program(self.program, f"hidden inverter {self.name}") if self.program else None

    def noisy(self, decibel: float, seed: int) -> "Hidden":
        """The same inverter measured with noise `decibel` below the norm of Y, its sigma known
        (`add_noise`).
        """
        return replace(self, sweep=add_noise(self.sweep, decibel, rng=np.random.default_rng(seed)))


def exact_model(
    program: str,
    values: Mapping[str, float],
    points: Iterable[OperatingPoint],
    f0_hz: float,
    power_node: PowerNode,
) -> Record:
    """The record of a program at given values, nothing fitted: its responses, matrices and poles at
    operating points.

    Equilibrium "exact". Raises IbridError when the program is illegal or `values` lacks one of its
    free parameters.
    """
    points = tuple(points)
    wiring = wire(parse_program(program), VOCABULARY)
    numbers = parameters_at(wiring, parameter_table(wiring, "exact"), values)
    return Record(
        outcome=Outcome.OK,
        program=program,
        parameters={op.name: dict(values) for op in points},
        settings={
            "equilibrium": "exact",
            "power_node": power_node,
            "f0_hz": f0_hz,
            "operating_points": {op.name: {"p": op.p, "q": op.q, "v": op.v} for op in points},
            "pade_orders": {
                name: pade_order(numbers[name][kind.delay], float(FREQUENCY[-1]))
                for name, kind in wiring.kinds.items()
                if kind.delay is not None
            },
        },
    )


def exact_sweep(model: Record, points: Iterable[OperatingPoint], source: str) -> Sweep:
    """The admittance of an exact model at operating points: 16 frequencies from 5 Hz to 5 kHz,
    clean.
    """
    return Sweep(
        tuple(PointSweep(op, FREQUENCY, model.response(op.name, FREQUENCY)) for op in points),
        f0_hz=model.settings["f0_hz"],
        power_node=model.settings["power_node"],
        source=source,
    )


def hidden_inverter(
    name: str,
    summary: str,
    program: str,
    values: Mapping[str, float],
    *,
    f0_hz: float = 60.0,
    power_node: PowerNode = "capacitor",
    held_out: OperatingPoint = HALF_LOAD,
) -> Hidden:
    """A hidden inverter swept at p = 1, q = +-0.3, with one further operating point held out."""
    model = exact_model(program, values, (*P1_Q03, held_out), f0_hz, power_node)
    source = f"hidden inverter {name}"
    return Hidden(
        name,
        summary,
        exact_sweep(model, P1_Q03, source),
        program,
        dict(values),
        exact_sweep(model, [held_out], f"{source}, held out"),
    )
