"""Devices that are model files, a DLL, an FMU or Python: opened in a process of their own, settled,
disturbed and measured.

Names are imported when they are first used, so that the process of a model loads nothing that it
does not need.
"""

from typing import TYPE_CHECKING

from ibrid.lazy import imported_by_need

if TYPE_CHECKING:  # the same names for type checkers
    from ibrid.devices.bench import DeviceBench
    from ibrid.devices.device_file import DeviceFile, SignalMeaning, read_device
    from ibrid.devices.fresh_device import MeasureSettings
    from ibrid.devices.isolation.process import ProcessLimits
    from ibrid.devices.measuring import measure
    from ibrid.devices.opening import TerminalDevice
    from ibrid.devices.recording_events import measure_events

__all__ = [
    "DeviceBench",
    "DeviceFile",
    "MeasureSettings",
    "ProcessLimits",
    "SignalMeaning",
    "TerminalDevice",
    "measure",
    "measure_events",
    "read_device",
]

#: Public name -> the module that it is imported from when it is first used.
HOMES = {
    "DeviceBench": "ibrid.devices.bench",
    "DeviceFile": "ibrid.devices.device_file",
    "MeasureSettings": "ibrid.devices.fresh_device",
    "ProcessLimits": "ibrid.devices.isolation.process",
    "SignalMeaning": "ibrid.devices.device_file",
    "TerminalDevice": "ibrid.devices.opening",
    "measure": "ibrid.devices.measuring",
    "measure_events": "ibrid.devices.recording_events",
    "read_device": "ibrid.devices.device_file",
}

if not TYPE_CHECKING:  # with it every misspelt name would have the type Any
    __getattr__ = imported_by_need(__name__, HOMES)
