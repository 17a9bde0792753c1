"""The hidden inverters of the benchmark: which there are, why each is among them, and where its
numbers come from.
"""

from collections.abc import Iterator, Mapping
from math import pi
from pathlib import Path

from ibrid_bench.recipes import recipes
from ibrid_bench.search.hidden import FREQUENCY, HALF_LOAD, Hidden, hidden_inverter

from ibrid.errors import IbridError, near
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.benchmarks import benchmarks
from ibrid.plants.published import BEYOND, PAPER_LIKE
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import is_stable, sweep
from ibrid.structure.diagrams.library import textbook_text

#: Published parameter sets: a gain in the feedforward, one without a PLL filter, one behind an L
#: filter.
PUBLISHED_SETS = ("published_sting_100mva", "published_feng_50kva", "published_kuleuven_600mva")
HARDWARE = ("gti_pq", "gti_ki20", "gti_absorbing")

#: Structures that equations (2) to (7) of the paper can express, as changes of the benchmark: there
#: is a nonlinear model.
CHANGES: Mapping[str, tuple[str, Mapping[str, float | str]]] = {
    "l_filter": (
        "L filter of 0.2 per unit, voltage measured at the terminals, filtered PLL",
        {
            "filter": "L",
            "L_F": 0.2,
            "R_F": 0.008,
            "C_F": 0.0,
            "L_g": 0.0,
            "R_g": 0.0,
            "kP_current": 0.3,
        },
    ),
    "no_decoupling": (
        "no decoupling of the axes in the current control, filtered PLL",
        {"decoupling": "none", "L_F": 0.12, "L_g": 0.1, "kP_current": 0.4, "kI_current": 25.0},
    ),
    "pll_and_power_filters": (
        "low-pass of 300 Hz before the PLL, of 60 Hz on p and q",
        {
            "omega_c_pll": 2 * pi * 300,
            "omega_c_power": 2 * pi * 60,
            "kP_pll": 80.0,
            "kI_pll": 2000.0,
            "kP_power": 0.1,
            "kI_power": 40.0,
            "L_g": 0.12,
        },
    ),
}

_LCL = {
    "plant.L_F": 0.12,
    "plant.R_F": 0.006,
    "plant.C_F": 0.05,
    "plant.L_g": 0.1,
    "plant.R_g": 0.008,
}
_PLL = {"pll.kP_pll": 90.0, "pll.kI_pll": 3000.0}
_GFL = {**_LCL, **_PLL, "power.kP": 0.02, "power.kI": 20.0, "decoupling.L": 0.12}

#: Structures that have no nonlinear model: summary and true values; per unit, s, rad/s.
DIAGRAMS: Mapping[str, tuple[str, Mapping[str, float]]] = {
    "filtered_feedforward": (
        "capacitor voltage fed forward through a low-pass of 500 Hz",
        {**_GFL, "current.kP": 0.4, "current.kI": 20.0, "feedforward.omega_c": 2 * pi * 500},
    ),
    "delay": (
        "the whole command delayed by 1.5 sampling periods at 10 kHz",
        {**_GFL, "current.kP": 0.4, "current.kI": 20.0, "delay.T_d": 1.5e-4},
    ),
    "droop": (
        "grid-forming: droops of 1 % on p and 5 % on q behind 5 Hz low-passes, voltage and current "
        "control",
        {
            **_LCL,
            "plant.L_g": 0.25,
            "power_filter.omega_c": 2 * pi * 5,
            "p_droop.k": -0.01 * 2 * pi * 60,
            "q_droop.k": -0.05,
            "voltage.kP": 1.0,
            "voltage.kI": 300.0,
            "current.kP": 0.7,
            "current.kI": 30.0,
        },
    ),
    "unusual": (
        "filtered current, capacitor-current damping, own gains for p and q, no feedforward: in no "
        "textbook program",
        {
            **_LCL,
            **_PLL,
            "decoupling.L": 0.12,
            "p_loop.kP": 0.03,
            "p_loop.kI": 25.0,
            "q_loop.kP": 0.01,
            "q_loop.kI": 12.0,
            "current_filter.omega_c": 2 * pi * 1500,
            "damping.k": -0.6,
            "current.kP": 0.5,
            "current.kI": 60.0,
        },
    ),
}


def inverter_names() -> tuple[str, ...]:
    """Names of the hidden inverters with a known truth, in the order of the tables."""
    random = sorted(name for name in benchmarks() if name.startswith("random_"))
    beyond = (plant.name for plant in BEYOND)
    return ("paper_like", *CHANGES, *DIAGRAMS, *PUBLISHED_SETS, *beyond, *random)


def inverters() -> Iterator[Hidden]:
    """All hidden inverters with a known truth."""
    return map(inverter, inverter_names())


def inverter(name: str) -> Hidden:
    """A hidden inverter, of hardware too where its data lie on this machine; IbridError with near
    names otherwise.
    """
    if name in CHANGES:
        summary, changes = CHANGES[name]
        return _from_plant(name, summary, PAPER_LIKE.with_overrides(changes))
    if name in DIAGRAMS:
        summary, values = DIAGRAMS[name]
        return hidden_inverter(name, summary, _program(name), values)
    if name in inverter_names():
        return _shipped(name, next(one.plant for one in recipes() if one.name == name))
    if name in HARDWARE:
        return _hardware(name)
    raise IbridError(
        f"there is no hidden inverter called {name}; {near(name, (*inverter_names(), *HARDWARE))}"
    )


def true_programs() -> Iterator[str]:
    """Program texts of all hidden inverters with a known truth; nothing is swept."""
    for name in inverter_names():
        plant = plant_of(name)
        yield _program(name) if plant is None else plant.program


def hardware() -> Iterator[Hidden]:
    """Measured inverters whose truth nobody published, where their data lie on this machine."""
    found = hardware_sweeps()
    return (_hardware(name) for name in HARDWARE if _file_of(name) in found)


def plant_of(name: str) -> ReferenceInverter | None:
    """The nonlinear model behind a hidden inverter; None where there is none."""
    if name in CHANGES:
        return PAPER_LIKE.with_overrides(CHANGES[name][1])
    return next((one.plant for one in recipes() if one.name == name), None)


def _from_plant(name: str, summary: str, plant: ReferenceInverter) -> Hidden:
    return hidden_inverter(
        name,
        summary,
        plant.program,
        plant.diagram_values,
        f0_hz=plant.f0_hz,
        power_node=plant.power_node,
    )


def _shipped(name: str, plant: ReferenceInverter) -> Hidden:
    """A sweep that ships with ibrid, read from its file; the held-out point from the nonlinear
    model.
    """
    return Hidden(
        name,
        plant.summary,
        read_sweep(benchmarks()[name]),
        plant.program,
        plant.diagram_values,
        sweep(plant, [_stable_point(plant)], FREQUENCY),
    )


def _stable_point(plant: ReferenceInverter) -> OperatingPoint:
    """p = 0.5, q = 0, or where the inverter is unstable there the nearest higher p, in steps of
    0.1, where it is not.
    """
    higher = (OperatingPoint(f"p={tenths / 10:g},q=0", tenths / 10, 0.0) for tenths in range(6, 10))
    return next(op for op in (HALF_LOAD, *higher) if is_stable(plant, op))


def _program(name: str) -> str:
    if name == "delay":
        return textbook_text("gfl_delay")
    return (Path(__file__).parent / "programs" / f"{name}.py").read_text(encoding="utf-8")


def _file_of(name: str) -> str:
    return "gti_pq" if name == "gti_absorbing" else name


def _hardware(name: str) -> Hidden:
    found = hardware_sweeps()
    if _file_of(name) not in found:
        raise IbridError(
            f"the data of {name} must lie where data/README.md says (IBRID_HARDWARE_DATA names the "
            "folder); they do not."
        )
    measured = read_sweep(found[_file_of(name)])
    if name == "gti_absorbing":
        return Hidden(
            name,
            "the first of them with the point absorbing alone, the point delivering held out",
            measured.only("absorbing"),
            held_out=measured.only("delivering"),
        )
    summary = {
        "gti_pq": "grid-tied inverter on the bench, two points",
        "gti_ki20": "the same, other PLL, one point",
    }
    return Hidden(name, summary[name], measured)
