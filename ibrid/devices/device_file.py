"""DEVICE.toml: which model file is measured, what its signals mean, and at which values it
starts.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import pi, sqrt
from pathlib import Path
from typing import Any

from ibrid.devices.power_stage import PowerStage, stage_of
from ibrid.errors import IbridError, near
from ibrid.foreign_data import text_in, toml_in
from ibrid.frozen import Frozen
from ibrid.ranges import LIMITS, finite_number, require_in_range

#: Kinds of device, and what `file` is of each.
KINDS: Mapping[str, str] = {
    "python": "FILE.py:OBJECT, an object with step(t, v_abc), or what makes one when it is called",
    "reference": "the name of a reference inverter, as `ibrid list` tells them",
    "fmu": "an FMU of FMI 2.0 or 3.0 for co-simulation",
    "cigre": "a library (.dll, .so) with the IEEE/CIGRE interface of Technical Brochure 958",
}
#: Signals of three phases, and references, which are one number: role -> quantity.
PHASES: Mapping[str, str] = {"v": "voltage", "i": "current"}
#: What a controller sees and says beside these, with a power stage around it: voltage at the
#: capacitor, current of the bridge, and the voltage that the bridge is to make.
AROUND: Mapping[str, str] = {"e": "voltage", "i_f": "current", "u": "voltage"}
REFERENCES: Mapping[str, str] = {
    "p_ref": "power",
    "q_ref": "power",
    "v_ref": "voltage",
    "f_ref": "frequency",
}
#: Unit of a signal -> quantity, and its size in SI units. Any quantity may be in "pu", a plain
#: number has none.
UNITS: Mapping[str, tuple[str, float]] = {
    "V": ("voltage", 1.0),
    "kV": ("voltage", 1e3),
    "A": ("current", 1.0),
    "kA": ("current", 1e3),
    "W": ("power", 1.0),
    "kW": ("power", 1e3),
    "MW": ("power", 1e6),
    "var": ("power", 1.0),
    "kvar": ("power", 1e3),
    "Mvar": ("power", 1e6),
    "VA": ("power", 1.0),
    "kVA": ("power", 1e3),
    "MVA": ("power", 1e6),
    "Hz": ("frequency", 1.0),
    "rad/s": ("frequency", 1 / (2 * pi)),
}
#: Keys of numbers at the top of the file; their ranges are declared in `ibrid.ranges`.
NUMBERS = ("step_s", "f0_hz", "s_base_va", "v_base_v", "sampling_hz", "settle_s")
#: The unit of `u` where it is a modulation index, which half of the DC voltage is to be multiplied
#: by.
MODULATION = "m"
_SIGNAL_KEYS = ("name", "unit", "scale", "sign")
_TOP_KEYS = ("kind", "file", *NUMBERS, "signals", "start", "parameters", "power_stage")


@dataclass(frozen=True)
class SignalMeaning(Frozen):
    """What one signal of a device means.

    names : of the device's own variables, three of a signal of three phases, one of a reference.
    per_unit : a number of the device times this is per unit, in our signs.
    """

    names: tuple[str, ...]
    per_unit: float


@dataclass(frozen=True)
class DeviceFile(Frozen):
    """A model file to be measured, and how its signals are meant. All of it is plain, so that it
    can go to another process.

    kind : of `KINDS`. file : as that says; a path is absolute. step_s : seconds between two calls.
    f0_hz, s_base_va, v_base_v : nominal frequency and per-unit base. sampling_hz : of the device's
    control, None: as `step_s`.
    settle_s : seconds before which a current that rests does not mean that the device has started.
    signals : role (of `PHASES` and `REFERENCES`) -> meaning. start : the device's inputs that are
    held, by its own names.
    parameters : by the device's own names. power_stage : around a controller, None of a whole
    inverter.
    """

    kind: str
    file: str
    step_s: float = 1e-4
    f0_hz: float = 50.0
    s_base_va: float | None = None
    v_base_v: float | None = None
    sampling_hz: float | None = None
    settle_s: float = 0.0
    signals: Mapping[str, SignalMeaning] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    power_stage: PowerStage | None = None

    @property
    def path(self) -> Path:
        """The file of the model, without the object in it."""
        file, mark, _ = self.file.rpartition(":")
        return Path(file if mark and self.kind == "python" else self.file)

    @property
    def references(self) -> tuple[str, ...]:
        """The references that the device takes."""
        return tuple(role for role in REFERENCES if role in self.signals)


def read_device(path: str | Path) -> DeviceFile:
    """The device that a DEVICE.toml tells of.

    Raises IbridError, one sentence with the key, what was found and what to write, for anything
    that is not as it must be.
    """
    try:
        content = toml_in(text_in(Path(path)))
    except OSError as error:
        raise IbridError(
            f"the device {path} cannot be read ({error.strerror}); give the path of a DEVICE.toml"
        ) from None
    except ValueError as error:
        raise IbridError(
            f"the device {path} is no TOML: {error}; ibrid measure FILE --describe writes one"
        ) from None
    return device_of(content, Path(path).absolute().parent, f"the device {path}")


def device_of(content: Mapping[str, Any], folder: Path, where: str) -> DeviceFile:
    """The same from what such a file holds.

    folder : from which `file` is meant. where : how errors begin.
    """
    _require_known(content, _TOP_KEYS, where)
    kind = str(content.get("kind"))
    if kind not in KINDS:
        raise IbridError(
            f"kind of {where} must be one of {', '.join(KINDS)}, found {kind!r:.40}; "
            f"{near(kind, KINDS)}"
        )
    file = content.get("file")
    if not isinstance(file, str) or not file:
        raise IbridError(f"file of {where} must be {KINDS[kind]}; found {file!r:.40}")
    numbers: dict[str, Any] = {
        name: _number(content, name, where) for name in NUMBERS if name in content
    }
    device = replace(DeviceFile(kind, _placed(kind, file, folder)), **numbers)
    if "power_stage" in content:
        table = _table(content, "power_stage", where)
        device = replace(
            device,
            power_stage=stage_of(table, _bases(device), device.f0_hz, f"power_stage of {where}"),
        )
    if device.power_stage and kind != "cigre":
        raise IbridError(
            f"{where} has a power_stage, which goes around a controller of kind cigre; leave it out"
        )
    signals = {
        role: _signal(role, entry, device, f"signals.{role} of {where}")
        for role, entry in _table(content, "signals", where).items()
    }
    if kind == "reference":
        return _reference(device, content, where)
    start = _table(content, "start", where)
    parameters = _table(content, "parameters", where)
    held = {name: _number(start, name, f"start of {where}") for name in start}
    values = {
        name: _value(value, f"parameters.{name} of {where}") for name, value in parameters.items()
    }
    return replace(device, signals=signals, start=held, parameters=values)


def _reference(device: DeviceFile, content: Mapping[str, Any], where: str) -> DeviceFile:
    """A reference inverter, which brings its nominal frequency and its base, and takes p_ref and
    q_ref per unit.
    """
    from ibrid.plants.sweeping import (
        plant_named,
    )  # with CasADi, which no process of another model needs

    if given := [
        key for key in ("signals", "start", "f0_hz", "s_base_va", "v_base_v") if key in content
    ]:
        raise IbridError(
            f"{where} has {given[0]}, which a reference inverter brings itself; leave it out"
        )
    values = {
        name: _value(value, f"parameters.{name} of {where}")
        for name, value in _table(content, "parameters", where).items()
    }
    plant = plant_named(device.file).with_overrides(values)
    return replace(
        device,
        f0_hz=plant.f0_hz,
        s_base_va=plant.s_base_va,
        v_base_v=plant.v_base_v,
        signals={role: SignalMeaning((role,), 1.0) for role in ("p_ref", "q_ref")},
        parameters=values,
    )


def _placed(kind: str, file: str, folder: Path) -> str:
    """The file with an absolute path, where it is one."""
    return file if kind == "reference" else str(folder / file)


def _signal(role: str, entry: Any, device: DeviceFile, where: str) -> SignalMeaning:
    known = {**PHASES, **(AROUND if device.power_stage else {}), **REFERENCES}
    if role not in known:
        raise IbridError(f"{where}: is no signal of a device; {near(role, known)}")
    if not isinstance(entry, Mapping):
        raise IbridError(
            f'{where} must be a table such as {{ name = "Pref", unit = "pu" }}; found {entry!r:.40}'
        )
    _require_known(entry, _SIGNAL_KEYS, where)
    named = entry.get("name", [])
    names = [named] if isinstance(named, str) else named
    if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
        raise IbridError(f"name of {where} must be a name or a list of names; found {named!r:.60}")
    if role in REFERENCES and len(names) != 1:
        raise IbridError(
            f"name of {where} must be one name, of the device's input; found {len(names)}"
        )
    sign = entry.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise IbridError(f"sign of {where} must be 1 or -1; found {sign!r:.40}")
    scale = _number(entry, "scale", where) if "scale" in entry else 1.0
    if not scale:
        raise IbridError(
            f"scale of {where} must not be 0; a number of the device times it is in the unit that "
            "is stated"
        )
    unit = entry.get("unit", "pu")
    if role == "u" and unit == MODULATION and device.power_stage:
        return SignalMeaning(tuple(names), float(sign * scale) * device.power_stage.v_dc / 2)
    return SignalMeaning(
        tuple(names), float(sign * scale) / _base_in(unit, known[role], device, where)
    )


def _bases(device: DeviceFile) -> tuple[float, float] | None:
    """Impedance and peak phase voltage that are 1 per unit, in ohm and V; None where nobody
    says.
    """
    if device.s_base_va is None or device.v_base_v is None:
        return None
    return device.v_base_v**2 / device.s_base_va, device.v_base_v * sqrt(2 / 3)


def _base_in(unit: Any, quantity: str, device: DeviceFile, where: str) -> float:
    """What is 1 per unit, in a unit."""
    if unit == "pu":
        return 1.0
    if not isinstance(unit, str) or unit not in UNITS:
        raise IbridError(
            f"unit of {where} must be pu or one of {', '.join(UNITS)}; found {unit!r:.40}"
        )
    meant, size = UNITS[unit]
    if meant != quantity:
        raise IbridError(
            f"unit of {where} is of a {meant}, and {quantity} is meant; give its own unit, or pu"
        )
    return base_of(quantity, device, where) / size


def base_of(quantity: str, device: DeviceFile, where: str) -> float:
    """The base of a quantity in SI units: peak of the phase voltage, peak current, three-phase
    power, nominal frequency.
    """
    if quantity == "frequency":
        return device.f0_hz
    if device.s_base_va is None or device.v_base_v is None:
        raise IbridError(
            f"{where} is in SI units, which need s_base_va and v_base_v (line to line, rms); write "
            "both at the top"
        )
    peak = device.v_base_v * sqrt(2 / 3)
    return {"voltage": peak, "power": device.s_base_va, "current": device.s_base_va / (1.5 * peak)}[
        quantity
    ]


def _table(content: Mapping[str, Any], name: str, where: str) -> Mapping[str, Any]:
    table = content.get(name, {})
    if not isinstance(table, Mapping):
        raise IbridError(f"{name} of {where} must be a table, [{name}]; found {table!r:.40}")
    return table


def _number(entry: Mapping[str, Any], name: str, where: str) -> float:
    """A finite number in the range that is declared for its name."""
    number = finite_number(entry[name])
    if number is None:
        raise IbridError(f"{name} of {where} must be a finite number; found {entry[name]!r:.40}")
    require_in_range(name if name in LIMITS else "value", number, f"{name} of {where}", IbridError)
    return number


def _value(value: Any, where: str) -> float | str:
    """A parameter: text, or a finite number (true and false are 1 and 0)."""
    if isinstance(value, str):
        return value
    number = float(value) if isinstance(value, bool) else finite_number(value)
    if number is None:
        raise IbridError(f"{where} must be a finite number or text; found {value!r:.40}")
    return number


def _require_known(entry: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    if unknown := [key for key in entry if key not in known]:
        raise IbridError(f"{where} has {unknown[0]!r:.40}; {near(unknown[0], known)}")
