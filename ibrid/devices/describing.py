"""What a model file offers, and a DEVICE.toml to correct: `ibrid measure FILE --describe`."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

import tomli_w

from ibrid.devices.device_file import REFERENCES, UNITS
from ibrid.errors import IbridError

#: Endings of libraries.
LIBRARIES = (".dll", ".so", ".dylib")


@dataclass(frozen=True)
class Description:
    """`lines` : what the file offers.

    `device` : what its DEVICE.toml may hold. `doubts` : what in it is guessed, or missing.
    """

    lines: Sequence[str]
    device: Mapping[str, Any]
    doubts: Sequence[str]

    @property
    def text(self) -> str:
        """As the command prints it: comments, then the DEVICE.toml."""
        comments = [f"# {line}".rstrip() for line in (*self.lines, "", *self.doubts)]
        return "\n".join(comments) + "\n" + tomli_w.dumps(dict(self.device))


def describe_here(file: str) -> dict[str, Any]:
    """What a model file offers, in the types of JSON; its code runs in this process.

    Raises IbridError for a file that is no model.
    """
    path = Path(file)
    if path.suffix == ".py":
        return vars(_of_python(path))
    if path.suffix.lower() in LIBRARIES:
        return vars(_of_library(path))
    if path.suffix.lower() == ".fmu":
        return vars(_of_fmu(path))
    raise IbridError(
        f"{file}: is no model file; --describe takes a .py, an .fmu, or a library "
        f"({', '.join(LIBRARIES)})"
    )


def _of_python(path: Path) -> Description:
    from ibrid.devices.python_device import devices_in, module_in

    module = module_in(path.absolute())
    names = devices_in(module)
    if not names:
        raise IbridError(
            f"{path}: nothing in it has step(t, v_abc); give an object or a class this method, "
            "which answers three currents"
        )
    lines = [f"{path.name}: has step(t, v_abc) in {', '.join(names)}"]
    chosen = getattr(module, names[-1])
    parameters = _numbers_of(chosen) if isinstance(chosen, type) else {}
    if isinstance(chosen, type):
        with suppress(Exception):  # it needs arguments, or anything else that only its user knows
            chosen = chosen()
    lines += [f"  {names[-1]} takes {name} = {value}" for name, value in parameters.items()]
    known = [role for role in REFERENCES if hasattr(chosen, role)]
    signals: dict[str, Any] = {"v": {"unit": "pu"}, "i": {"unit": "pu", "sign": 1}}
    signals |= {role: {"name": role, "unit": "pu"} for role in known}
    device = {
        "kind": "python",
        "file": f"{path.name}:{names[-1]}",
        "step_s": 1e-4,
        "f0_hz": 50.0,
        "signals": signals,
    }
    doubts = [
        'guessed: step_s, f0_hz and every unit; in V and A write unit = "V", unit = "A" and '
        "s_base_va, v_base_v at the top",
        "sign of i: 1 where step answers the current out of the device, -1 where it answers that "
        "into it",
        *(
            []
            if known
            else [
                "no attribute p_ref, q_ref, v_ref or f_ref was found: name its references in "
                "[signals]"
            ]
        ),
    ]
    return Description(lines, device | ({"parameters": parameters} if parameters else {}), doubts)


def _numbers_of(made: type) -> dict[str, float | str]:
    """The arguments of a class that have a number or a text as default."""
    try:
        arguments = signature(made).parameters.values()
    except (ValueError, TypeError):
        return {}
    given = {one.name: one.default for one in arguments if one.default is not Parameter.empty}
    return {name: value for name, value in given.items() if isinstance(value, int | float | str)}


#: Ends of names that belong together: of three phases, counted from 0 or 1, of d and q.
ENDS = (
    ("a", "b", "c"),
    ("A", "B", "C"),
    ("[0]", "[1]", "[2]"),
    ("[1]", "[2]", "[3]"),
    ("d", "q"),
    ("D", "Q"),
)
#: What the words of a signal's name and description say of its role, in the order in which they are
#: asked.
_CURRENTS = (
    ("i_f", ("vsc", "converter", "inverter", "bridge", "i1", "if")),
    ("i", ("grid", "after", "i2", "ig")),
)


def _of_library(path: Path) -> Description:
    from ibrid.devices.cigre_library import load_library

    library = load_library(str(path.absolute()))
    lines = [
        f"{path.name}: {library.name}, {'; '.join(library.words)}",
        f"called every {library.sample_s!r} s",
    ]
    for title, ports in (
        ("input", library.inputs),
        ("output", library.outputs),
        ("parameter", library.parameters),
    ):
        for port in ports.values():
            value = f" = {port.usual}" if title == "parameter" else ""
            lines.append(f"{title} {port.name}{value} [{port.unit}] {port.description}")
    signals, doubts = guessed_signals(library.inputs, library.outputs)
    device: dict[str, Any] = {
        "kind": "cigre",
        "file": path.name,
        "step_s": library.sample_s or 1e-5,
        "f0_hz": 50.0,
    }
    if any(entry["unit"] != "pu" for entry in signals.values()):
        device |= {"s_base_va": 1e6, "v_base_v": 400.0}
    device |= stated_by_parameters(library.parameters, device, doubts)
    if "v_base_v" in device:
        doubts.append("put in your own: f0_hz, s_base_va and v_base_v (line to line, rms)")
    if "u" in signals:
        device["power_stage"] = {"L_f": 0.1, "R_f": 0.005, "v_dc": 2.5}
        doubts.append(
            "a controller: put the filter and the DC voltage into [power_stage], per unit, or with "
            'unit = "si"'
        )
    named = {name for entry in signals.values() for name in entry["name"]}
    start = {name: 0.0 for name in library.inputs if name not in named}
    doubts += (
        [f"[start] holds the inputs {', '.join(start)}: put in what they should be"]
        if start
        else []
    )
    doubts += [
        f"{port.name} may be how long it takes to start: put a longer time into settle_s"
        for port in library.parameters.values()
        if port.unit == "s" and "start" in port.name.lower()
    ]
    return Description(
        lines, {**device, "signals": signals, "start": start, "parameters": {}}, doubts
    )


def _of_fmu(path: Path) -> Description:
    from ibrid.devices.fmu_device import description_of, offered

    description = description_of(path.absolute())
    lines = [
        f"{path.name}: {description.modelName}, FMI {description.fmiVersion}, "
        f"{description.description or 'no further word'}"
    ]
    ports = {kind: offered(description, [kind]) for kind in ("input", "output", "parameter")}
    named = {
        kind: {name: _port_of(one) for name, one in variables.items()}
        for kind, variables in ports.items()
    }
    for kind, variables in named.items():
        for port in variables.values():
            value = f" = {port.usual}" if kind == "parameter" else ""
            lines.append(f"{kind} {port.name}{value} [{port.unit}] {port.description}")
    signals, doubts = guessed_signals(named["input"], named["output"])
    step = description.defaultExperiment and description.defaultExperiment.stepSize
    device: dict[str, Any] = {
        "kind": "fmu",
        "file": path.name,
        "step_s": float(step or 1e-5),
        "f0_hz": 50.0,
    }
    if any(entry["unit"] != "pu" for entry in signals.values()):
        device |= {"s_base_va": 1e6, "v_base_v": 400.0}
    device |= stated_by_parameters(named["parameter"], device, doubts)
    doubts.append(
        "put in your own: step_s, f0_hz, and where a unit is not pu s_base_va and v_base_v (line "
        "to line, rms)"
    )
    taken = {name for entry in signals.values() for name in entry["name"]}
    start = {name: 0.0 for name in named["input"] if name not in taken}
    doubts += (
        [f"[start] holds the inputs {', '.join(start)}: put in what they should be"]
        if start
        else []
    )
    return Description(
        lines, {**device, "signals": signals, "start": start, "parameters": {}}, doubts
    )


#: Names of parameters, in small letters without _, that say a base or the nominal frequency -> key
#: of a DEVICE.toml, factor of its number and least and largest value that is believed.
_SAID_BY = (
    (re.compile(r"f(0|n|nom|base|nominal)|fgrid"), "f0_hz", 1.0, (10.0, 500.0)),
    (
        re.compile(r"(w|omega)(0|n|nom|base|nominal)"),
        "f0_hz",
        1 / (2 * math.pi),
        (10.0, 500.0),
    ),
    (re.compile(r"vll(base|n|nom|rms|rated)?"), "v_base_v", 1.0, (10.0, 1e6)),
    (re.compile(r"s(base|n|nom|rated)"), "s_base_va", 1.0, (10.0, 1e10)),
)
_FACTORS = {"k": 1e3, "M": 1e6}


def stated_by_parameters(
    parameters: Mapping[str, Any], device: Mapping[str, Any], doubts: list[str]
) -> dict[str, float]:
    """Bases and nominal frequency that the model's own parameters state by their usual values; a
    doubt names them.
    """
    stated: dict[str, float] = {}
    sources = []
    for port in parameters.values():
        name = port.name.rpartition(".")[2].lower().replace("_", "")
        for pattern, key, factor, (least, largest) in _SAID_BY:
            if key not in device or key in stated or not pattern.fullmatch(name):
                continue
            try:
                value = float(port.usual) * factor * _prefix_of(port.unit)
            except ValueError:
                continue
            if least <= value <= largest:
                stated[key] = float(f"{value:.4g}") if key == "f0_hz" else value
                sources.append(f"{key} from the parameter {port.name}")
    if sources:
        doubts.append(f"taken: {', '.join(sources)}")
    return stated


def _prefix_of(unit: str) -> float:
    """1e3 of kV, 1e6 of MVA, else 1."""
    return _FACTORS.get(unit[:1], 1.0) if unit[1:] in ("V", "VA", "W") else 1.0


@dataclass(frozen=True)
class OfferedVariable:
    """A variable of an FMU, as ports of libraries are told."""

    name: str
    unit: str
    description: str
    usual: str


def _port_of(variable: Any) -> OfferedVariable:
    words = variable.description or ""
    unit = variable.unit or ("pu" if "per unit" in words else "")
    return OfferedVariable(variable.name, unit, words, str(variable.start))


def guessed_signals(
    inputs: Mapping[str, Any], outputs: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """[signals] as names, units and words suggest them, and what is unsure in them.

    Three that differ in their phase alone belong together; in volts they are voltages, the first of
    them that at the terminals.
    """
    signals: dict[str, Any] = {}
    for names in _together(inputs):
        port = inputs[names[0]]
        role = _role_of_input(port, signals)
        if role:
            signals[role] = {"name": names, "unit": _unit(port)}
    answers = _together(outputs)
    currents = [names for names in answers if _is_of(outputs[names[0]], "current", ("A", "kA"))]
    if currents:
        answer = {"name": currents[0], "unit": _unit(outputs[currents[0][0]]), "sign": 1}
        signals = {role: entry for role, entry in signals.items() if role == "v"} | {"i": answer}
    elif answers:
        unit = _unit(outputs[answers[0][0]])
        signals["u"] = {"name": answers[0], "unit": unit if unit in ("V", "kV") else "m"}
    for role in REFERENCES:
        words = role.replace("_", "")
        found = [name for name in inputs if name.lower().replace("_", "") == words]
        if found:
            signals[role] = {"name": found, "unit": _unit(inputs[found[0]])}
    told = ", ".join(f"{role} = {' '.join(entry['name'])}" for role, entry in signals.items())
    return signals, [f"guessed from names and units: {told}"]


def _together(ports: Mapping[str, Any]) -> list[list[str]]:
    """Names that differ in a, b and c at their end alone, in [0], [1] and [2], or in d and q."""
    groups = []
    for name in ports:
        for first, *others in ENDS:
            stem = name.removesuffix(first)
            names = [name, *(stem + end for end in others)]
            if name.endswith(first) and all(one in ports for one in names):
                groups.append(names)
    return groups


def _role_of_input(port: Any, taken: Mapping[str, Any]) -> str:
    """v, e, i_f or i; empty where it is none, or is taken."""
    if _is_of(port, "voltage", ("V", "kV")):
        roles = ["v", "e"]
    elif _is_of(port, "current", ("A", "kA")):
        words = f"{port.name} {port.description}".lower()
        said = [role for role, hints in _CURRENTS if any(hint in words for hint in hints)]
        roles = [*said, "i_f", "i"]
    else:
        return ""
    return next((role for role in roles if role not in taken), "")


def _is_of(port: Any, quantity: str, units: Sequence[str]) -> bool:
    """Whether unit or description say that it is of a quantity."""
    return _unit(port) in units or quantity in port.description.lower()


def _unit(port: Any) -> str:
    """As a device file writes it; pu where it is none of its units."""
    return next((unit for unit in UNITS if unit.lower() == port.unit.strip().lower()), "pu")
