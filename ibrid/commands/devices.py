"""`ibrid measure DEVICE`: a model file of somebody else on the bench, as a sweep, as records of
events, or described.
"""

from argparse import Namespace
from typing import TYPE_CHECKING

from ibrid.commands.outputs import command_line, give_events, say_sweep
from ibrid.errors import IbridError
from ibrid.own_files import also_reading
from ibrid.streams import complain
from ibrid.writing import require_place, write_whole

if TYPE_CHECKING:
    from ibrid.devices.device_file import DeviceFile

#: Frequencies that are measured where none are named.
USUAL = "5:2000:40"


def run_measure(arguments: Namespace) -> int:
    """Describe, or measure and write the file."""
    if arguments.describe:
        return _describe(arguments)
    if arguments.out is None or not arguments.op:
        raise IbridError(
            "--op p=..,q=.. and --out FILE must be given to measure a device; --describe only "
            "looks at a file"
        )
    if arguments.event and arguments.freq is not None:
        raise IbridError(
            "--freq asks for a sweep and --event for records, which are two files; measure one "
            "after the other"
        )
    require_place(arguments.out)

    from ibrid.devices.device_file import read_device

    device = read_device(arguments.device)
    also_reading({"the model file": device.path})
    if device.kind != "reference":
        complain(f"runs {device.path} in a process of its own")
    return _record(arguments, device) if arguments.event else _sweep(arguments, device)


def _describe(arguments: Namespace) -> int:
    from ibrid.devices.isolation.process import described

    if arguments.out is not None:
        require_place(arguments.out)
    complain(f"runs {arguments.device} in a process of its own")
    text = described(arguments.device).text
    if arguments.out is None:
        print(text, end="")
    else:
        write_whole(arguments.out, text)
    return 0


def _sweep(arguments: Namespace, device: "DeviceFile") -> int:
    from ibrid.devices.fresh_device import MeasureSettings
    from ibrid.devices.measuring import measure
    from ibrid.measurement.conventions.contradictions import check_conventions
    from ibrid.plants.sweeping import frequency_grid
    from ibrid.telling import telling

    settings = MeasureSettings(peak=arguments.peak)
    line = command_line(arguments, "measure", arguments.device, options=("op", "freq", "peak"))
    with telling() as tell:
        sweep = measure(
            device,
            arguments.op,
            frequency_grid(arguments.freq or USUAL),
            out=arguments.out,
            header=(f"made by: {line}",),
            settings=settings,
            tell=tell,
        )
    for sentence in check_conventions(sweep).warnings:
        complain(f"of the sweep: {sentence}")
    say_sweep(sweep, arguments.out)
    return 0


def _record(arguments: Namespace, device: "DeviceFile") -> int:
    from ibrid.devices.fresh_device import MeasureSettings
    from ibrid.devices.recording_events import measure_events
    from ibrid.telling import telling

    settings = MeasureSettings(peak=arguments.peak, rate=arguments.rate)
    line = command_line(
        arguments, "measure", arguments.device, options=("op", "event", "rate", "length")
    )
    with telling() as tell:
        events = measure_events(
            device,
            arguments.op,
            arguments.event,
            length=arguments.length,
            settings=settings,
            tell=tell,
        )
    give_events(events, arguments.out, f"made by: {line}")
    return 0
