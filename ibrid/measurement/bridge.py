"""From anything that answers (frequency, axis, operating point) with a response to a sweep: a
simulator, a test bench.

What is answered is kept at once, so a measurement that was stopped goes on where it ended.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.telling import Tell, silent

AXES = ("d", "q")
#: (frequency in Hz, axis of the injected voltage, operating point) -> the current (d, q) out of the
#: inverter over that voltage, per unit, in the frame of the voltage at rest.
Device = Callable[[float, str, OperatingPoint], Sequence[complex] | np.ndarray]


def bridged(
    device: Device,
    frequency: Sequence[float],
    points: Sequence[OperatingPoint],
    out: str | Path,
    *,
    tell: Tell = silent,
    **header: Any,
) -> Sweep:
    """Measure a device at all frequencies of all operating points, and write the sweep to `out`.

    Parameters
    ----------
    device : asked once for each frequency, axis and operating point.
    frequency : Hz, ascending.
    out : CSV of the sweep. Beside it `out` with the ending .part has every answer, a line each,
    until all are there.
    tell : is told what is going on. header : f0_hz, power_node, bases, sampling_hz, notes and
    source, as of `Sweep`.

    Raises
    ------
    SweepError : an answer that is not two finite numbers, or answers in the .part file of other
    operating points.
    """
    path = Path(out)
    kept = path.with_suffix(".part")
    answers = dict(_kept(kept, points))
    asked = [(point, float(hz), axis) for point in points for hz in frequency for axis in AXES]
    with kept.open("a", encoding="utf-8") as lines:
        lines.write("\n")  # ends a line that was cut off
        for number, (point, hz, axis) in enumerate(asked):
            if (point.name, hz, axis) in answers:
                continue
            tell(f"{point.name}: {hz:g} Hz, {axis}", number / len(asked))
            response = _checked(device(hz, axis, point), point, hz)
            answers[point.name, hz, axis] = response
            parts = [[one.real, one.imag] for one in response]
            at = {"op": point.name, "p": point.p, "q": point.q, "v": point.v}
            lines.write(json.dumps({**at, "hz": hz, "axis": axis, "response": parts}) + "\n")
            lines.flush()
    grid = np.asarray(frequency, dtype=float)
    shape = len(points), len(grid), len(AXES), 2
    columns = np.array([answers[point.name, hz, axis] for point, hz, axis in asked]).reshape(shape)
    measured = [
        PointSweep(one, grid, matrix.mT) for one, matrix in zip(points, columns, strict=True)
    ]
    sweep = Sweep(tuple(measured), **header)
    write_sweep(sweep, path)
    kept.unlink()
    return sweep


def _kept(
    path: Path, points: Sequence[OperatingPoint]
) -> Iterator[tuple[tuple[str, float, str], np.ndarray]]:
    """The answers of an earlier time; a last line that was cut off is asked again."""
    ops = {one.name: one for one in points}
    for text in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        try:
            line = json.loads(text)
            key = str(line["op"]), float(line["hz"]), str(line["axis"])
            rest = tuple(float(line[name]) for name in "pqv")
            response = np.array([complex(*part) for part in line["response"]])
        except (ValueError, KeyError, TypeError):
            continue
        if key[0] in ops and not np.allclose(
            rest, [getattr(ops[key[0]], name) for name in "pqv"], rtol=1e-6, atol=1e-9
        ):
            raise SweepError(
                f"{path} has answers at another operating point of the name {key[0]}; remove it, "
                "or measure into another file"
            )
        yield key, response


def _checked(
    answer: Sequence[complex] | np.ndarray, point: OperatingPoint, hz: float
) -> np.ndarray:
    response = np.asarray(answer, dtype=complex)
    if response.shape != (2,) or not np.isfinite(response).all():
        raise SweepError(
            "the device must answer with two finite numbers, the d and q current over the "
            f"injected voltage; at {hz:g} Hz of "
            f"{point.name} it gave {answer!r:.60}"
        )
    return response
