"""A functional mock-up unit as a device, by FMPy: FMI 2.0 and 3.0, co-simulation.

Law: from sample to sample the inputs stand at the mean of the voltages at both ends, so that a line
is followed to the second order of the step; behind the step the inputs are those of the sample, and
the outputs are read.
"""

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.devices.device_file import DeviceFile
from ibrid.devices.frame import to_dq, to_phases, turning
from ibrid.errors import IbridError, near

#: Types of variables of FMI 2.0 and 3.0 -> what FMPy calls the functions that set and get them.
FUNCTIONS: Mapping[str, str] = {
    "Real": "Real",
    "Integer": "Integer",
    "Enumeration": "Integer",
    "Boolean": "Boolean",
    "String": "String",
    **{
        name: name
        for name in (
            "Float32",
            "Float64",
            "Int8",
            "UInt8",
            "Int16",
            "UInt16",
            "Int32",
            "UInt32",
            "Int64",
            "UInt64",
        )
    },
}


class FmuDevice:
    """An FMU as a `TerminalDevice`; voltages and currents are three phases, or d and q of the frame
    that turns.
    """

    def __init__(self, device: DeviceFile) -> None:
        self._device = device
        self._description = description_of(Path(device.file))
        self._variables = {one.name: one for one in self._description.modelVariables}
        self._before: np.ndarray | None = None
        self._in_places, self._given = self._arrays("v", "input")
        self._out_places, self._answered = self._arrays("i", "output")
        self._fmu = _instantiated(Path(device.file), self._description)
        for name, value in {**device.parameters, **device.start}.items():
            self._set(name, value)

    def put(self, reference: str, value: float) -> None:
        """Set a reference, per unit."""
        meaning = self._device.signals[reference]
        self._set(meaning.names[0], value / meaning.per_unit)

    move = put

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        """(n, 3) currents at the voltages (n, 3), per unit, at the samples from `first` on."""
        step_s = self._device.step_s
        signals = self._device.signals
        turn = turning(first, len(v), step_s, self._device.f0_hz)
        voltages = _as_many(v, len(self._given), turn) / signals["v"].per_unit
        answers = np.empty((len(v), len(self._answered)))
        for k, voltage in enumerate(voltages):
            if self._before is None:
                self._write(voltage)
                self._begin(first * step_s)
            else:
                self._write((self._before + voltage) / 2)
                self._fmu.doStep((first + k - 1) * step_s, step_s)
                self._write(voltage)
            self._before = voltage
            answers[k] = self._read()
        return _as_phases(answers * signals["i"].per_unit, turn)

    def _begin(self, time: float) -> None:
        """From instantiation to the first sample."""
        if self._is_third:
            self._fmu.enterInitializationMode(startTime=time)
        else:
            self._fmu.setupExperiment(startTime=time)
            self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    @property
    def _is_third(self) -> bool:
        return self._description.fmiVersion.startswith("3")

    def _write(self, values: np.ndarray) -> None:
        self._given[:] = values.tolist()
        self._exchange(
            "fmi3SetFloat64" if self._is_third else "fmi2SetReal", self._in_places, self._given
        )

    def _read(self) -> list[float]:
        self._exchange(
            "fmi3GetFloat64" if self._is_third else "fmi2GetReal", self._out_places, self._answered
        )
        return list(self._answered)

    def _exchange(self, function: str, places: Any, numbers: Any) -> None:
        """Set or get numbers in arrays that are made once; FMPy makes new ones each time."""
        counts = [len(places), len(places)] if self._is_third else [len(places)]
        getattr(self._fmu, function)(self._fmu.component, places, counts[0], numbers, *counts[1:])

    def _arrays(self, role: str, causality: str) -> tuple[Any, Any]:
        """Value references of the variables of a role, and as many numbers."""
        if role not in self._device.signals:
            raise IbridError(
                f"{self._device.file}: [signals] lacks {role}, the three numbers, or d and q, that "
                "it is"
            )
        names = self._device.signals[role].names
        if len(names) not in (2, 3):
            raise IbridError(
                f"{self._device.file}: name of signals.{role} must be three names, or two of d and "
                "q; found "
                f"{len(names)}"
            )
        for name in names:
            variable = self._variable(name)
            if variable.causality != causality or variable.type not in ("Real", "Float64"):
                raise IbridError(
                    f"{self._device.file}: {name} must be an {causality} that is a number; it is "
                    f"{variable.causality}, "
                    f"{variable.type}"
                )
        places = [self._variable(name).valueReference for name in names]
        return (ctypes.c_uint * len(places))(*places), (ctypes.c_double * len(places))()

    def _variable(self, name: str) -> Any:
        if name not in self._variables:
            raise IbridError(
                f"{self._device.file}: has no variable {name!r:.60}; {near(name, self._variables)}"
            )
        return self._variables[name]

    def _set(self, name: str, value: float | str) -> None:
        variable = self._variable(name)
        function = (
            "Int64"
            if self._is_third and variable.type == "Enumeration"
            else FUNCTIONS.get(variable.type)
        )
        if function is None or isinstance(value, str) != (function == "String"):
            raise IbridError(
                f"{self._device.file}: {name} is of type {variable.type}, found {value!r:.40} for "
                "it"
            )
        is_whole = function not in ("Real", "Float32", "Float64")
        given = round(value) if is_whole and not isinstance(value, str) else value
        getattr(self._fmu, f"set{function}")([variable.valueReference], [given])


def description_of(path: Path) -> Any:
    """What an FMU says of itself, as FMPy reads it.

    Raises IbridError without FMPy, and for a file that is no FMU for co-simulation of FMI 2.0 or
    3.0 with a binary for this platform.
    """
    try:
        import fmpy
    except ImportError:
        raise IbridError("an FMU needs FMPy; install it with: pip install 'ibrid[fmu]'") from None
    if not path.is_file():
        raise IbridError(f"{path}: there is no such file; correct `file` in the device file")
    try:
        description = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:  # whatever a damaged file makes of it
        raise IbridError(
            f"{path}: is no FMU that can be read ({' '.join(str(error).split())[:200]}); export it "
            "again"
        ) from None
    if str(description.fmiVersion)[:1] not in ("2", "3"):
        raise IbridError(
            f"{path}: is of FMI {description.fmiVersion}, 2.0 and 3.0 are known; export it as one "
            "of those"
        )
    if description.coSimulation is None:
        raise IbridError(
            f"{path}: is for model exchange alone, and has no solver; export it for co-simulation"
        )
    if fmpy.platform not in platforms and fmpy.platform_tuple not in platforms:
        raise IbridError(
            f"{path}: has no binary for {fmpy.platform}, only for "
            f"{', '.join(platforms) or 'none'}; measure it "
            "there, or export it with one"
        )
    return description


def _instantiated(path: Path, description: Any) -> Any:
    """An instance, unpacked into the folder for temporary files of this process, which the one that
    began it takes away.
    """
    import fmpy

    folder = fmpy.extract(str(path))
    return fmpy.instantiate_fmu(
        folder, description, fmi_type="CoSimulation", require_functions=False
    )


def _as_many(v: np.ndarray, count: int, turn: np.ndarray) -> np.ndarray:
    """(n, 3) phases as they are, or as d and q (n, 2)."""
    if count == 3:
        return v
    dq = to_dq(v, turn)
    return np.column_stack([np.real(dq), np.imag(dq)])


def _as_phases(i: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(n, 3) of three phases, or of d and q."""
    return i if i.shape[1] == 3 else to_phases(i[:, 0] + 1j * i[:, 1], turn)


def offered(description: Any, causality: Sequence[str]) -> dict[str, Any]:
    """The variables of some causality that are numbers, by name."""
    return {
        one.name: one
        for one in description.modelVariables
        if one.causality in causality and one.type in FUNCTIONS and not one.dimensions
    }
