"""What every device can do once it is open, and how a file becomes one."""

from typing import Protocol

import numpy as np

from ibrid.devices.device_file import DeviceFile


class TerminalDevice(Protocol):
    """A device at its terminals, per unit, current out of it, its own clock counted in samples."""

    def put(self, reference: str, value: float) -> None:
        """Set a reference (p_ref, q_ref, v_ref, f_ref), per unit."""

    def move(self, reference: str, value: float) -> None:
        """Set one reference while the device runs, per unit, and no other with it."""

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        """(n, 3) phase currents at the phase voltages (n, 3) of the samples from `first` on, which
        follow those before.
        """
        ...


def open_here(device: DeviceFile) -> TerminalDevice:
    """Open a device in this process; code of others needs one of its own, `devices.isolation`."""
    if device.kind == "reference":
        from ibrid.devices.reference_device import ReferenceDevice

        return ReferenceDevice(device)
    if device.kind == "fmu":
        from ibrid.devices.fmu_device import FmuDevice

        return FmuDevice(device)
    if device.kind == "cigre":
        from ibrid.devices.cigre_device import CigreDevice

        return CigreDevice(device)
    from ibrid.devices.python_device import PythonDevice

    return PythonDevice(device)
