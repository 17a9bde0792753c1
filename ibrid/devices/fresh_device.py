"""A device that can be begun anew, as every operating point and every event needs it, and how much
it is given.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from ibrid.devices.bench import DeviceBench
from ibrid.devices.device_file import DeviceFile, SignalMeaning, read_device
from ibrid.devices.isolation.process import NO_HURRY, ProcessDevice, ProcessLimits
from ibrid.devices.opening import TerminalDevice, open_here
from ibrid.devices.python_device import PythonDevice
from ibrid.errors import IbridError
from ibrid.own_files import announce
from ibrid.ranges import require_in_range


@dataclass(frozen=True)
class MeasureSettings:
    """How a device is measured.

    peak : of the injected voltage on each axis, per unit. repeats : periods that are measured.
    most_periods : in which the
    answer must become periodic. longest_s : simulated seconds in which the device must settle once
    it has started.
    rate : samples per second of records. limits : of the device's process.
    """

    peak: float = 0.005
    repeats: int = 3
    most_periods: int = 12
    longest_s: float = 20.0
    rate: float = 5000.0
    limits: ProcessLimits = NO_HURRY

    def __post_init__(self) -> None:
        require_in_range("peak", self.peak, "the peak of the injected voltage", IbridError)
        if not 2 <= self.repeats < self.most_periods <= 1000:
            raise IbridError(
                "repeats must be 2 or more and most_periods above it, at most 1000; "
                f"found {self.repeats} and {self.most_periods}"
            )
        for name in ("longest_s", "rate"):
            if not 0 < getattr(self, name) < inf:
                raise IbridError(
                    f"{name} must be a finite number above 0; found {getattr(self, name):g}"
                )


USUAL = MeasureSettings()


@dataclass(frozen=True, eq=False)
class FreshDevice:
    """A device that can be begun anew. make : a fresh one, within a `with` of `bench`."""

    file: DeviceFile
    make: Callable[[], TerminalDevice]
    settings: MeasureSettings

    @classmethod
    def of(
        cls, device: Any, step_s: float, f0_hz: float, settings: MeasureSettings
    ) -> "FreshDevice":
        """Of a device file, its path, or an object with `step`.

        Raises IbridError for anything else.
        """
        if isinstance(device, str | Path):
            announce(Path(device))
            device = read_device(device)
        if isinstance(device, DeviceFile):
            announce(device.path)
            return cls(device, lambda: ProcessDevice(device, settings.limits), settings)
        if not callable(getattr(device, "step", None)):
            raise IbridError(
                "a device is a DEVICE.toml or an object with step(t, v_abc); found a "
                f"{type(device).__name__}, give one of them"
            )
        require_in_range("step_s", step_s, "step_s of the device", IbridError)
        require_in_range("f0_hz", f0_hz, "f0_hz of the device", IbridError)
        signals = {
            role: SignalMeaning((role,), 1.0)
            for role in ("p_ref", "q_ref", "v_ref")
            if hasattr(device, role)
        }
        file = DeviceFile("python", type(device).__name__, step_s, f0_hz, signals=signals)
        return cls(file, lambda: PythonDevice(file, deepcopy(device)), settings)

    @classmethod
    def here(cls, file: DeviceFile, settings: MeasureSettings) -> "FreshDevice":
        """In this process: of ours alone, such as a reference inverter."""
        return cls(file, lambda: open_here(file), settings)

    @contextmanager
    def bench(self) -> Iterator[DeviceBench]:
        """A fresh device on the bench; its process ends with the block.

        Raises IbridError where an output is named as one of the files that the model read.
        """
        device = self.make()
        try:
            yield DeviceBench(
                device,
                self.file.step_s,
                self.file.f0_hz,
                self.settings.longest_s,
                self.file.settle_s,
            )
            files_read = getattr(device, "files_read", list)()
            announce(*map(Path, files_read))
        finally:
            close = getattr(device, "close", None)
            if close is not None:
                close()
