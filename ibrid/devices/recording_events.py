"""Record what a device answers to events on its terminal voltage."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.assembly.set_points import SET_POINTS
from ibrid.border import takes_kinds
from ibrid.devices.device_file import DeviceFile
from ibrid.devices.fresh_device import USUAL, FreshDevice, MeasureSettings
from ibrid.errors import IbridError
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.sweeping import operating_point
from ibrid.playback.recording import Event, event_of, named_records
from ibrid.telling import Tell, silent


@takes_kinds
@hearing_interrupts()
def measure_events(
    device: Any,
    operating_points: Sequence[OperatingPoint | str],
    events: Sequence[Event | str],
    *,
    step_s: float = 1e-4,
    f0_hz: float = 50.0,
    length: float | None = None,
    settings: MeasureSettings = USUAL,
    tell: Tell = silent,
) -> Events:
    """Record what a device answers to events: one record for each operating point and event, each
    with the device anew.

    device, operating_points, step_s, f0_hz : as of `measure`. events : or "dip:0.6,at=0.1,for=0.15"
    (`ibrid record`).
    length : s of a record; None: what the event needs.

    Raises IbridError as `measure`, for an event that does not lie in its record, and for one that
    moves a reference which the device does not take.
    """
    opened = FreshDevice.of(device, step_s, f0_hz, settings)
    points = [operating_point(one) if isinstance(one, str) else one for one in operating_points]
    asked = [event_of(one) if isinstance(one, str) else one for one in events]
    file = opened.file
    _require_references(asked, file)
    every = max(round(1 / (settings.rate * file.step_s)), 1)
    records = []
    planned = named_records(points, asked, file.f0_hz, 1 / (every * file.step_s), length)
    for number, (name, op, event, whole) in enumerate(planned):
        tell(f"{name}: settles", number / len(planned))
        with opened.bench() as bench:
            rest, references = bench.reach(op, file.references)
            time = np.arange(round(whole / (every * file.step_s)) * every + 1) * file.step_s
            v = event.voltage(time, op.v)
            at_rest = replace(op, p=references.get("p_ref", op.p), q=references.get("q_ref", op.q))
            told = event.told(time, at_rest)
            tell(f"{name}: recorded", (number + 0.5) / len(planned))
            i = bench.play_telling(v, told)[::every]
        shown = time[::every]
        seen = np.column_stack([np.real(v), np.imag(v)])[::every]
        told = {role: value[::every] for role, value in told.items()}
        outside = np.column_stack([seen, *told.values()])
        happens = np.any(outside != outside[0], axis=1)
        rest_end = float(shown[max(int(np.argmax(happens)) - 1, 0)])
        records.append(EventRecord(replace(rest, name=name), shown, seen, i, rest_end, told=told))
    return Events(
        tuple(records),
        f0_hz=file.f0_hz,
        power_node="pcc",
        s_base_va=file.s_base_va,
        v_base_v=file.v_base_v,
        source=f"device {Path(file.file).name}",
    )


def _require_references(events: Sequence[Event], file: DeviceFile) -> None:
    """Raise IbridError for an event that moves a reference which the device does not take."""
    for event in events:
        if event.kind in SET_POINTS and event.kind not in file.references:
            takes = ", ".join(file.references) or "none"
            raise IbridError(
                f"the event {event.name} moves {event.kind}, and the device takes {takes} of the "
                "references; name it in [signals], or choose another event"
            )
