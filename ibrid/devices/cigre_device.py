"""A library of the IEEE/CIGRE interface as a device: a whole inverter, or a controller with a power
stage around it.

The library is called once a sample, as its interface has it; all of a block of samples runs in
compiled code.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, pi

import numpy as np

from ibrid.devices.cigre_library import TYPES, CigreInstance, CigrePort, load_library
from ibrid.devices.device_file import DeviceFile
from ibrid.devices.power_stage import SENSED, PowerStage
from ibrid.errors import IbridError, near

#: Types of numbers in their order within the compiled loop.
KINDS = tuple(sorted(set(TYPES.values())))


@dataclass(frozen=True, eq=False)
class LibraryWires:
    """Numbers of a structure that are written or read in every step. kind, place : in the views of
    `KINDS`. source : which of the twelve sensed numbers, or of three phases. gain : a number of
    ours times it is the library's.
    """

    kind: np.ndarray
    place: np.ndarray
    source: np.ndarray
    gain: np.ndarray


class CigreDevice:
    """A library as a `TerminalDevice`."""

    def __init__(self, device: DeviceFile) -> None:
        library = load_library(device.file)
        if library.sample_s > 0 and abs(device.step_s / library.sample_s - 1) > 1e-9:
            raise IbridError(
                f"{device.file}: wants to be called every {library.sample_s!r} s and step_s is "
                f"{device.step_s!r}; write "
                f"step_s = {library.sample_s!r}"
            )
        self._device = device
        self._library = library
        self._instance = CigreInstance(library, device.parameters)
        self._begun = False
        stage = device.power_stage
        sensed = SENSED if stage else ("v",)
        answer = "u" if stage else "i"
        for role in ("v", "i_f", "u") if stage else ("v", "i"):
            if role not in device.signals and not (role == "i_f" and "i" in device.signals):
                raise IbridError(
                    f"{device.file}: [signals] lacks {role}, the three numbers of the library that "
                    "it is"
                )
        inputs = [(role, k) for k, role in enumerate(sensed) if role in device.signals]
        self._in = self._wired(inputs, library.inputs, inverse=True)
        self._out = self._wired([(answer, 0)], library.outputs, inverse=False)
        for name, value in device.start.items():
            self._instance.put(name, value)
        self._motion = _Motion.of(stage, device) if stage else _Motion.nothing()

    def put(self, reference: str, value: float) -> None:
        """Set a reference, per unit."""
        meaning = self._device.signals[reference]
        self._instance.put(meaning.names[0], value / meaning.per_unit)

    move = put

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        """(n, 3) currents at the voltages (n, 3), per unit, at the samples from `first` on."""
        from ibrid.devices.library_loop import (
            run_library,
        )  # with numba, once the library is known to be one

        instance, motion, device = self._instance, self._motion, self._device
        if not self._begun:
            self._write_first(v[0])
            instance.begin()
            self._begun = True
        i = np.empty_like(v)
        failed = run_library(
            self._library.functions["Outputs"],
            instance.address,
            instance.memory,
            first,
            device.step_s,
            np.ascontiguousarray(v),
            i,
            tuple(instance.inputs[kind] for kind in KINDS),
            tuple(instance.outputs[kind] for kind in KINDS),
            (self._in.kind, self._in.place, self._in.source, self._in.gain),
            (self._out.kind, self._out.place, self._out.gain),
            motion.laws,
            motion.memory,
        )
        if failed >= 0:
            instance.require(2, "Model_Outputs")
        return i

    def _wired(
        self, roles: Sequence[tuple[str, int]], ports: Mapping[str, CigrePort], *, inverse: bool
    ) -> LibraryWires:
        """The numbers of some roles; inverse : from per unit to the library's numbers."""
        kind, place, source, gain = [], [], [], []
        for role, row in roles:
            meaning = self._device.signals[role]
            for phase, name in enumerate(_three(meaning.names, ports, role, self._device.file)):
                kind.append(KINDS.index(TYPES[ports[name].type]))
                place.append(ports[name].place)
                source.append(3 * row + phase)
                gain.append(1 / meaning.per_unit if inverse else meaning.per_unit)
        whole = [np.array(one, dtype=np.int64) for one in (kind, place, source)]
        return LibraryWires(whole[0], whole[1], whole[2], np.array(gain, dtype=float))

    def _write_first(self, v: np.ndarray) -> None:
        """The first voltages, before the library is initialised."""
        for wire in range(len(self._in.kind)):
            row, phase = divmod(int(self._in.source[wire]), 3)
            if SENSED[row] in ("v", "e"):
                view = self._instance.inputs[KINDS[self._in.kind[wire]]]
                view[self._in.place[wire]] = self._in.gain[wire] * v[phase]


@dataclass(frozen=True, eq=False)
class _Motion:
    """What the compiled loop needs of a power stage, or that there is none (no states).

    laws : of the states from step to step, of what is sensed, and (share of a sensor's error that a
    step takes away, limit, 1 or 0 whether there is a stage). memory : states, bridge voltages from
    the one to come to the one applied, v of the last step, what sensors show, and (1 or 0 whether
    there was a step).
    """

    laws: tuple[np.ndarray, ...]
    memory: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, stage: PowerStage, device: DeviceFile) -> "_Motion":
        omega_0 = 2 * pi * device.f0_hz
        _, _, sensed, through = stage.laws(omega_0)
        a, b = stage.stepped(omega_0, device.step_s)
        share = 1 - exp(-2 * pi * stage.sensor_hz * device.step_s) if stage.sensor_hz else 1.0
        numbers = np.array([share, stage.limit, 1.0])
        return cls((a, b, sensed, through, numbers), _memory(len(a), stage.delay_steps))

    @classmethod
    def nothing(cls) -> "_Motion":
        empty = np.zeros((0, 0))
        laws = (
            empty,
            np.zeros((0, 3)),
            np.zeros((4, 0)),
            np.zeros((4, 2)),
            np.array([1.0, 1.0, 0.0]),
        )
        return cls(laws, _memory(0, 0))


def _memory(states: int, delay_steps: int) -> tuple[np.ndarray, ...]:
    return (
        np.zeros((states, 3)),
        np.zeros((delay_steps + 1, 3)),
        np.zeros(3),
        np.zeros((4, 3)),
        np.zeros(1),
    )


def _three(names: Sequence[str], ports: Mapping[str, CigrePort], role: str, file: str) -> list[str]:
    """The names of three numbers: of three signals, or of one signal of three."""
    listed = [f"{names[0]}[{phase}]" for phase in range(3)] if len(names) == 1 else list(names)
    if len(listed) != 3:
        raise IbridError(
            f"{file}: name of signals.{role} must be three names, or one of a signal of three "
            f"numbers; found {len(names)}"
        )
    for name in listed:
        if name not in ports:
            raise IbridError(
                f"{file}: has no {name!r:.60}, which signals.{role} names; {near(name, ports)}"
            )
    return listed
