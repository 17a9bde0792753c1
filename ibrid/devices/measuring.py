"""Measure a device: its dq admittance at operating points, as a sweep."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.devices.experiment import measure_response
from ibrid.devices.fresh_device import USUAL, FreshDevice, MeasureSettings
from ibrid.devices.kept_points import PART, KeptPoints, MeasuredPoint, files_of
from ibrid.devices.multisine import Multisine, multisine_for
from ibrid.errors import SweepError
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.frequencies import frequencies_of
from ibrid.measurement.sweeps.noise import SIMULATED
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep
from ibrid.own_files import writing_as
from ibrid.plants.sweeping import operating_point
from ibrid.telling import Tell, silent


@takes_kinds
@hearing_interrupts()
def measure(
    device: Any,
    operating_points: Sequence[OperatingPoint | str],
    frequency: Sequence[float] | np.ndarray,
    *,
    step_s: float = 1e-4,
    f0_hz: float = 50.0,
    out: str | Path | None = None,
    header: Sequence[str] = (),
    settings: MeasureSettings = USUAL,
    tell: Tell = silent,
) -> Sweep:
    """Measure the dq admittance of a device by injected multisines.

    At each operating point the device starts anew, its references are found, it settles, and
    orthogonal multisines on d and q are injected at two amplitudes. The sweep's sigma holds the
    scatter of the periods, what lies in bins that are not excited, and what the second amplitude
    shows of odd powers; its p and q are those that the device delivers at its terminals.

    Parameters
    ----------
    device : DEVICE.toml, a `DeviceFile`, or an object with `step(t, v_abc) -> i_abc`, per unit, at
    t (s): peak phase values,
        current out of the device. The attributes p_ref, q_ref, v_ref of an object, where it has
        them, are its references. A file runs in a process of its own; of an object every operating
        point is measured with a copy of it.
    operating_points : or "p=1,q=0.3[,v=1.02]", per unit, at the terminals.
    frequency : (K,) Hz, ascending; measured is at the nearest odd bins of a common period.
    step_s, f0_hz : of an object; a file says its own.
    out, header : CSV of the sweep, and comment lines in it. Beside it `out` with the ending .part
    keeps every point until all
        are there.

    Raises
    ------
    IbridError : a device that cannot be opened, fails, crashes, hangs, answers no numbers, or does
    not settle; an `out` that is a file of the device.
    """
    measured = measure_timed(
        device,
        operating_points,
        frequency,
        step_s=step_s,
        f0_hz=f0_hz,
        out=out,
        header=header,
        settings=settings,
        tell=tell,
    )
    return measured.sweep


@dataclass(frozen=True)
class TimedSweep:
    """A sweep, and the seconds that the device lived for it."""

    sweep: Sweep
    simulated_s: float


def measure_timed(
    device: Any,
    operating_points: Sequence[OperatingPoint | str],
    frequency: Sequence[float] | np.ndarray,
    *,
    step_s: float = 1e-4,
    f0_hz: float = 50.0,
    out: str | Path | None = None,
    header: Sequence[str] = (),
    settings: MeasureSettings = USUAL,
    tell: Tell = silent,
) -> TimedSweep:
    """Measure as `measure` does, and say how long the device lived."""
    named = [] if out is None else [str(out), str(Path(out).with_suffix(PART))]
    with writing_as("measure", named=named):
        opened = FreshDevice.of(device, step_s, f0_hz, settings)
        points = [operating_point(one) if isinstance(one, str) else one for one in operating_points]
        if not points:
            raise SweepError(
                "there must be an operating point to measure at; give one such as p=0.5,q=0"
            )
        if len({one.name for one in points}) < len(points):
            raise SweepError("operating points must have different p, q or v; found one twice.")
        grid = frequencies_of(frequency)
        file = opened.file
        multisine = multisine_for(grid, file.step_s, file.f0_hz, file.sampling_hz)
        kept = KeptPoints.beside(out, file, points, multisine, settings)
        for number, op in enumerate(points):
            if op.name not in kept.points:
                heard = partial(_heard, tell, op.name, number, len(points))
                kept.add(_measured_point(opened, op, multisine, settings, heard))
        measured = [kept.points[op.name] for op in points]
        sweep = Sweep(
            tuple(point.swept(multisine, settings.peak) for point in measured),
            f0_hz=file.f0_hz,
            power_node="pcc",
            s_base_va=file.s_base_va,
            v_base_v=file.v_base_v,
            sampling_hz=file.sampling_hz,
            notes=(_how(multisine, settings), *(point.note for point in measured)),
            source=f"device {Path(file.file).name}",
        )
        if out is not None:
            write_sweep(sweep, out, header=header)
            kept.drop()
    for sentence in filter(None, (point.warning(multisine.frequency) for point in measured)):
        warnings.warn(sentence, stacklevel=3)
    return TimedSweep(sweep, sum(point.simulated_s for point in measured))


def _measured_point(
    opened: FreshDevice,
    op: OperatingPoint,
    multisine: Multisine,
    settings: MeasureSettings,
    heard: Callable[[float], None],
) -> MeasuredPoint:
    heard(0.0)
    with opened.bench() as bench:
        rest, references = bench.reach(op, opened.file.references)
        response = measure_response(
            bench,
            op.v,
            multisine,
            peak=settings.peak,
            repeats=settings.repeats,
            most_periods=settings.most_periods,
            heard=heard,
        )
        files = getattr(bench.device, "files_read", list)()
        return MeasuredPoint(rest, references, response, bench.simulated_s, files_of(files))


def _heard(tell: Tell, name: str, number: int, count: int, share: float) -> None:
    tell(f"{name}: {'measured' if share else 'settles'}", (number + share) / count)


def _how(multisine: Multisine, settings: MeasureSettings) -> str:
    """How it was measured, for the file."""
    period = multisine.samples * multisine.step_s
    return (
        f"{SIMULATED} that reach {settings.peak:g} and twice that per unit, lines at "
        "odd multiples of "
        f"{1 / period:.6g} Hz, {multisine.samples} samples of {multisine.step_s:g} s a period"
    )
