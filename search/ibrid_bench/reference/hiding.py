"""What is hidden in each reference inverter for the gap workflow: a block that the model lacks, or
that the device has beyond it.

Blocks that a device has beyond its textbook program are mostly those that its source has and
`docs/inverters.md` leaves out.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import pi
from zlib import crc32

import numpy as np
from ibrid_bench.search.hidden import HALF_LOAD, Hidden, exact_model, exact_sweep
from ibrid_bench.search.inverters import inverter, plant_of

from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.reference import P1_Q03
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

#: Standard deviation of the logarithm of nominal values about the true ones.
NOMINAL_ERROR = 0.15
_SEED = 6


@dataclass(frozen=True)
class Hiding:
    """A hidden effect. `inverter` : whose. `effect` : id in the catalogue. `words` : for people.
    `edit` : of the textbook program.

    `values` : of the parameters that the edit brings in; then the device has them and the textbook
    program is the model. {} : the edit takes something away, and what is left is the model of the
    textbook program's device.
    """

    inverter: str
    effect: str
    words: str
    edit: Callable[[Draft], None]
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class GapCase:
    """What the gap workflow gets.

    `sweep` : of the device, with a point to be held out. `values` : nominal, {} for none.
    """

    model: Diagram
    sweep: Sweep
    held_out: str
    values: Mapping[str, float]


def itself(name: str) -> GapCase:
    """The textbook program and the shipped sweep of its device, nothing hidden, no nominal
    values.
    """
    hidden = inverter(name)
    point = _held_out(hidden)
    return GapCase(_program(hidden), _with_point(hidden.sweep, hidden.held_out), point.name, {})


def hidden_case(hiding: Hiding) -> GapCase:
    """A device with the effect, and the model without it, its nominal values wrong by
    `NOMINAL_ERROR`.

    Raises IbridError where the device is unstable at an operating point that is fitted.
    """
    hidden = inverter(hiding.inverter)
    textbook, point, true = _program(hidden), _held_out(hidden), dict(hidden.values or {})
    draft = Draft(textbook, VOCABULARY)
    hiding.edit(draft)
    draft.tidy()
    edited = draft.diagram()
    if hiding.values:
        sweep = _device(hiding, hidden, program_text(edited), {**true, **hiding.values}, point)
        model = textbook
    else:
        sweep, model = _with_point(hidden.sweep, hidden.held_out), edited
    return GapCase(model, sweep, point.name, _nominal(hiding, model, true))


def _device(
    hiding: Hiding, hidden: Hidden, program: str, values: Mapping[str, float], point: OperatingPoint
) -> Sweep:
    plant = plant_of(hiding.inverter)
    if plant is None:
        raise IbridError(f"{hiding.inverter} has no nonlinear model; choose a reference inverter")
    points = (*P1_Q03, point)
    device = exact_model(program, values, points, plant.f0_hz, plant.power_node)
    for op in P1_Q03:
        slowest = float(np.real(np.linalg.eigvals(device.state_space(op.name).A)).max())
        if slowest >= 0:
            raise IbridError(
                f"{hiding.inverter} with {hiding.words} must be stable to be measured; at "
                f"{op.name} it has a pole at "
                f"{slowest:.3g} rad/s, choose other values"
            )
    return exact_sweep(device, points, f"reference inverter {hiding.inverter} with {hiding.words}")


def _nominal(hiding: Hiding, model: Diagram, true: Mapping[str, float]) -> dict[str, float]:
    rng = np.random.default_rng([_SEED, crc32(f"{hiding.inverter} {hiding.words}".encode())])
    names = parameter_table(wire(model, VOCABULARY), "exact").names
    return {
        name: true[name] * float(np.exp(NOMINAL_ERROR * rng.standard_normal())) for name in names
    }


def _program(hidden: Hidden) -> Diagram:
    return parse_program(hidden.program, f"reference inverter {hidden.name}")


def _held_out(hidden: Hidden) -> OperatingPoint:
    return hidden.held_out.points[0].op if hidden.held_out else HALF_LOAD


def _with_point(data: Sweep, held: Sweep | None) -> Sweep:
    return data if held is None else replace(data, points=(*data.points, *held.points))


# --- edits
# ----------------------------------------------------------------------------------------------


def _without(*names: str) -> Callable[[Draft], None]:
    """Blocks of one input and one output taken out of their path."""

    def edit(draft: Draft) -> None:
        for name in reversed(names):  # the first lends its parameters to the others
            draft.bypass(name)

    return edit


def _unwired(source: str, target: str) -> Callable[[Draft], None]:
    return lambda draft: draft.disconnect(source, target)


def _removed(name: str) -> Callable[[Draft], None]:
    return lambda draft: draft.remove(name)


def _delayed(plant: str = "plant", *alike: str) -> Callable[[Draft], None]:
    """The whole command delayed; `alike` : further inputs that take the command."""

    def edit(draft: Draft) -> None:
        name = draft.insert_before(f"{plant}.u_r", "Delay", "delay")
        for other in alike:
            for source in draft.sources(other):
                draft.disconnect(source, other)
            draft.connect(f"{name}.out", other)

    return edit


def _before(target: str, kind: str, stem: str) -> Callable[[Draft], None]:
    def edit(draft: Draft) -> None:
        draft.insert_before(target, kind, stem)

    return edit


def _virtual_reactance(draft: Draft) -> None:
    name = draft.add("JMul_omega", "virtual_reactance")
    draft.connect("plant.i_g", f"{name}.in_")
    for source in draft.sources("plant.delta_omega"):
        draft.connect(source, f"{name}.delta_omega")
    draft.connect(draft.negated(f"{name}.out"), "voltage.in_")


def _filtered_feedforward(draft: Draft) -> None:
    targets = ["plant.u_r", "dc_link.u"]
    draft.insert("plant.e", targets, "LPF1_dq", "feedforward_filter")


#: At least two effects of every reference inverter that make sense for it.
HIDINGS: tuple[Hiding, ...] = (
    Hiding("paper_like", "pll_prefilter", "500 Hz low-pass before the PLL", _without("pll_filter")),
    Hiding("paper_like", "decoupling", "decoupling", _removed("decoupling")),
    Hiding("paper_like", "control_delay", "delay of 100 us", _delayed(), {"delay.T_d": 1e-4}),
    Hiding("gfl_l_filter", "control_delay", "delay of 200 us", _delayed(), {"delay.T_d": 2e-4}),
    Hiding(
        "gfl_l_filter",
        "pll_prefilter",
        "80 Hz low-pass before the PLL",
        _before("pll.e_q", "LPF1", "pll_filter"),
        {"pll_filter.omega_c": 2 * pi * 80},
    ),
    Hiding(
        "gfl_l_filter",
        "voltage_feedforward",
        "voltage feedforward",
        _unwired("plant.e", "plant.u_r"),
    ),
    Hiding("gfl_dc_link", "active_damping", "active damping", _removed("damping")),
    Hiding(
        "gfl_dc_link",
        "control_delay",
        "delay of 250 us",
        _delayed("plant", "dc_link.u"),
        {"delay.T_d": 2.5e-4},
    ),
    Hiding(
        "gfl_dc_link",
        "voltage_feedforward_filter",
        "3 kHz low-pass in the feedforward",
        _filtered_feedforward,
        {"feedforward_filter.omega_c": 2 * pi * 3000},
    ),
    Hiding("gfm_droop", "virtual_impedance", "virtual reactance", _removed("virtual_reactance")),
    Hiding("gfm_droop", "power_filter", "low-pass of p before the droop", _without("p_filter")),
    Hiding("gfm_droop", "control_delay", "delay of 100 us", _delayed(), {"delay.T_d": 1e-4}),
    Hiding("gfm_vsm", "virtual_impedance", "virtual reactance", _removed("virtual_reactance")),
    Hiding("gfm_vsm", "power_filter", "low-pass of q before the droop", _without("q_filter")),
    Hiding("gfm_vsm", "control_delay", "delay of 100 us", _delayed(), {"delay.T_d": 1e-4}),
    Hiding(
        "gfm_dvoc",
        "virtual_impedance",
        "virtual reactance of 0.2",
        _virtual_reactance,
        {"virtual_reactance.L": 0.2},
    ),
    Hiding("gfm_dvoc", "decoupling", "decoupling of the current", _removed("decoupling")),
    Hiding("gfm_dvoc", "control_delay", "delay of 50 us", _delayed(), {"delay.T_d": 5e-5}),
    Hiding(
        "hybrid_gfl_gfm", "power_filter", "low-passes of p and q", _without("p_filter", "q_filter")
    ),
    Hiding("hybrid_gfl_gfm", "decoupling", "decoupling", _removed("decoupling")),
    Hiding("hybrid_gfl_gfm", "control_delay", "delay of 100 us", _delayed(), {"delay.T_d": 1e-4}),
    Hiding(
        "parallel_gfl_gfm",
        "control_delay",
        "delay of 200 us in the grid-following device",
        _delayed("gfl_plant"),
        {"delay.T_d": 2e-4},
    ),
    Hiding(
        "parallel_gfl_gfm",
        "virtual_impedance",
        "virtual reactance of the grid-forming device",
        _removed("gfm_virtual_reactance"),
    ),
)
