"""What playback costs by length of the record and states of the model, and CVODES through CasADi
beside the compiled steps.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ibrid.assembly.averaged import equations
from ibrid.assembly.rest import Rest, rest
from ibrid.gap.recordings.event_misfit import STEP
from ibrid.measurement.recordings.events import EventRecord
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import plant_named
from ibrid.playback.player import FINE, Player
from ibrid.playback.port import solved
from ibrid.playback.recording import event_of, record_events
from ibrid.structure.diagrams.program import parse_program

#: Inverters of several numbers of states; lengths of records, s.
INVERTERS = ("gfl_l_filter", "gfl_dc_link", "paper_like", "gfm_droop", "gfm_vsm")
LENGTHS = (0.4, 1.6, 6.4)
#: Relative and absolute tolerance of CVODES, and its longest step, s, without which it steps from
#: rest over the event.
TOLERANCES, LONGEST = (1e-8, 1e-10), 1e-3


@dataclass(frozen=True)
class Cost:
    """Seconds. `join` : of the laws, once for a diagram.

    `plays` : by length of the record. `slopes` : of all parameters in 0.4 s, as a fit takes them.
    `cvodes`, `cvodes_slopes` : the same by CVODES and its forward sensitivities. `apart` : of both
    currents, in parts of what happens.
    """

    inverter: str
    states: int
    parameters: int
    join: float
    plays: tuple[float, ...]
    slopes: float
    cvodes: float
    cvodes_slopes: float
    apart: float

    @property
    def cells(self) -> tuple[str, ...]:
        """A row of the table."""
        sizes = (self.inverter, str(self.states), str(self.parameters))
        seconds = (self.join, *self.plays, self.slopes, self.cvodes, self.cvodes_slopes)
        return (*sizes, *(f"{one:.2g}" for one in seconds), f"{self.apart:.0e}")


HEADER = (
    "inverter",
    "states",
    "parameters",
    "joining its laws",
    *(f"{one:g} s played" for one in LENGTHS),
    "all slopes of 0.4 s",
    "CVODES, 0.4 s",
    "CVODES, slopes",
    "apart",
)


def cost_of(name: str) -> Cost:
    """Of one reference inverter's own program, in a dip to 0.8 at 5 kHz."""
    plant = plant_named(name)
    diagram, values = parse_program(plant.program), dict(plant.diagram_values)
    records = [_record(plant, length) for length in LENGTHS]
    Player(diagram, VOCABULARY, (), 2 * np.pi * plant.f0_hz).play(
        records[0], [values]
    )  # compiled code is loaded
    player = Player(diagram, VOCABULARY, (), 2 * np.pi * plant.f0_hz)
    join = _seconds(lambda: player.play(_cut(records[0], 8), [values]), times=1)
    plays = tuple(
        _seconds(lambda record=record: player.play(record, [values], step=FINE))
        for record in records
    )
    nearby = [
        values,
        *({**values, one.name: values[one.name] * 1.0003} for one in player.parameters),
    ]
    slopes = _seconds(lambda: player.play(records[0], nearby, step=STEP))
    (own,) = player.play(records[0], [values])
    cvodes = _Cvodes(player, records[0], values)
    current, seconds = cvodes.current()
    happens = np.linalg.norm(own.current - own.current[0])
    return Cost(
        name,
        len(cvodes.start),
        len(player.parameters),
        join,
        plays,
        slopes,
        seconds,
        cvodes.slopes(len(player.parameters)),
        float(np.linalg.norm(current - own.current) / happens),
    )


class _Cvodes:
    """The same laws and the same spline of the voltage, integrated by CVODES."""

    def __init__(self, player: Player, record: EventRecord, values: Mapping[str, float]) -> None:
        at = rest(
            player.wiring,
            player.table,
            values,
            (record.rest.p, record.rest.q, record.rest.v),
            power_node="pcc",
            omega_0=player.omega_0,
            pade_orders=dict(player._orders(values)),
        )
        self.record, (self.rates, self.out, self.numbers) = record, _laws(player, at)
        self.start = np.array([value for module in at.modules for value in at.states[module.name]])

    def current(self) -> tuple[np.ndarray, float]:
        """(N, 2), and the seconds it takes."""
        integrate = self._integrator()
        run = lambda: np.array(integrate(x0=self.start, p=self.numbers)["xf"])  # noqa: E731
        seconds = _seconds(run)
        states = np.hstack([self.start[:, None], run()])
        found = [
            np.array(self.out(x, v, self.numbers)).ravel()
            for x, v in zip(states.T, self.record.v, strict=True)
        ]
        return np.array(found), seconds

    def slopes(self, number: int) -> float:
        """Seconds of forward sensitivities to so many of the modules' numbers."""
        integrate = self._integrator()
        forward = integrate.forward(number)
        seeds = {
            "fwd_p": np.eye(len(self.numbers))[:, :number],
            "x0": self.start,
            "p": self.numbers,
        }
        return _seconds(lambda: forward(**seeds), times=1)

    def _integrator(self) -> ca.Function:
        x, p, t = ca.MX.sym("x", len(self.start)), ca.MX.sym("p", len(self.numbers)), ca.MX.sym("t")
        time_, v = self.record.time, self.record.v
        voltage = [ca.interpolant("v", "bspline", [time_], v[:, axis])(t) for axis in (0, 1)]
        problem = {"x": x, "p": p, "t": t, "ode": self.rates(x, ca.vertcat(*voltage), p)}
        options = {
            "reltol": TOLERANCES[0],
            "abstol": TOLERANCES[1],
            "max_num_steps": 1_000_000,
            "max_step_size": LONGEST,
        }
        return ca.integrator("played", "cvodes", problem, float(time_[0]), time_[1:], options)


def _laws(player: Player, at: Rest) -> tuple[ca.Function, ca.Function, np.ndarray]:
    symbols, constants, numbers = {}, [], []
    for module in at.modules:
        own = {}
        for name, value in module.arguments.items():
            parts = list(value) if isinstance(value, tuple) else [value]
            symbol = ca.SX.sym(f"{module.name}.{name}", len(parts))
            constants.append(symbol)
            numbers += [float(one) for one in parts]
            own[name] = (symbol[0], symbol[1]) if len(parts) == 2 else symbol
        symbols[module.name] = own
    x = {module.name: ca.SX.sym(module.name, len(module.states)) for module in at.modules}
    v, references = ca.SX.sym("v", 2), {one: ca.SX(value) for one, value in at.references.items()}
    joined = equations(player.wiring, at.modules, x, v, references, symbols)
    found = [joined.rates, joined.current]
    if joined.loops:
        found = [
            ca.substitute(one, joined.unknown, solved(joined.residual, joined.unknown))
            for one in found
        ]
    arguments = [ca.vertcat(*x.values()), v, ca.vertcat(*constants)]
    rates, out = (
        ca.Function(name, arguments, [ca.densify(one)])
        for name, one in zip(("f", "h"), found, strict=True)
    )
    return rates, out, np.array(numbers)


def _record(plant: ReferenceInverter, length: float) -> EventRecord:
    event = event_of("dip:0.8,at=0.1,for=0.15")
    return record_events(plant, plant.operating_points[:1], [event], length=length).records[0]


def _cut(record: EventRecord, samples: int) -> EventRecord:
    return EventRecord(
        record.rest, record.time[:samples], record.v[:samples], record.i[:samples], record.time[1]
    )


def _seconds(run, times: int = 3) -> float:
    """Least processor time of some calls: other work on the machine does not change it."""
    found = []
    for _ in range(times):
        begun = time.process_time()
        run()
        found.append(time.process_time() - begun)
    return min(found)
