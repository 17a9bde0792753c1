"""What else the numbers of a sweep or a recording could be, and why they are not: each usual
mistake, tried on them.

A reading is excluded where a law that needs no model contradicts it: the inductance of the filter
high up, the power at rest low down, the cross terms that show f0.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ibrid.measurement.conventions.contradictions import check_conventions
from ibrid.measurement.conventions.frequency_base import frequency_readings
from ibrid.measurement.quality.plausibility import implausible_numbers
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

_MIRROR, _QUARTER = np.diag([1.0, -1.0]), np.array([[0.0, -1.0], [1.0, 0.0]])
#: Factors of an admittance that come from mistakes of unit and base.
_FACTORS = {
    "line for phase voltage in the base (Y times 3)": 3.0,
    "peak for rms in the base (Y times 2)": 2.0,
    "Park's factor 3/2 (Y times 1.5)": 1.5,
    "a prefix of the unit, m or k (Y times 1000)": 1e3,
}
#: How near f0 must be to another nominal frequency to be it, as a part.
_NEAR_HZ = 0.05
#: Voltages at rest of a grid, per unit.
_USUAL = (0.85, 1.15)
_OPEN = "nothing in the numbers speaks against it"


@dataclass(frozen=True)
class OtherReading:
    """`words` : what the numbers would be.

    `verdict` : "excluded: .." with the law, or that nothing in them speaks against it.
    """

    words: str
    verdict: str


def other_readings(sweep: Sweep) -> tuple[OtherReading, ...]:
    """The usual mistakes tried on a sweep, one by one."""
    own = set(_sentences(sweep))
    return tuple(
        OtherReading(words, _verdict(other, own)) for words, other in _others(sweep)
    ) + _frequency(sweep)


def _others(sweep: Sweep) -> Iterator[tuple[str, Sweep]]:
    yield "the current counted the other way", _changed(sweep, lambda y: -y)
    yield "the q axis on the other side", _changed(sweep, lambda y: _MIRROR @ y @ _MIRROR)
    yield (
        "the voltage at rest on the other axis",
        _changed(sweep, lambda y: _QUARTER.T @ y @ _QUARTER),
    )
    yield "impedances in place of admittances", _changed(sweep, np.linalg.inv)
    yield "d and q exchanged in rows (columns swapped)", _changed(sweep, lambda y: y[:, ::-1, :])
    for words, factor in _FACTORS.items():
        yield words, _changed(sweep, lambda y, factor=factor: y * factor)
    turns = [replace(point, frequency=point.frequency / (2 * np.pi)) for point in sweep.points]
    yield "frequencies in rad/s", replace(sweep, points=tuple(turns))


def _changed(sweep: Sweep, change) -> Sweep:
    """The sweep with other admittances, without noise and amplitudes, which laws do not ask for."""
    points = [
        PointSweep(point.op, point.frequency, change(np.array(point.admittance)))
        for point in sweep.points
    ]
    return replace(sweep, points=tuple(points))


def _sentences(sweep: Sweep) -> tuple[str, ...]:
    return (*check_conventions(sweep).warnings, *implausible_numbers(sweep))


def _verdict(other: Sweep, own: set[str]) -> str:
    against = [sentence for sentence in _sentences(other) if sentence not in own]
    if against:
        return f"excluded: {against[0].split(':')[0].rstrip('.')}"
    return _OPEN


def _frequency(sweep: Sweep) -> tuple[OtherReading, ...]:
    """What the highest frequencies say of 50 and 60 Hz."""
    readings = [
        reading.hertz
        for reading in frequency_readings(sweep)
        if reading is not None and reading.sure
    ]
    other = 50.0 if abs(sweep.f0_hz - 60) < 1 else 60.0
    words = f"f0 = {other:g} Hz in place of {sweep.f0_hz:g} Hz"
    if not readings:
        return (OtherReading(words, _OPEN),)
    mean = float(np.mean(readings))
    near = abs(mean / other - 1) < _NEAR_HZ
    shown = f"the highest frequencies read {mean:.3g} Hz"
    return (OtherReading(words, f"LIKELY: {shown}" if near else f"excluded: {shown}"),)


def other_readings_of_records(events: Events) -> tuple[OtherReading, ...]:
    """The usual mistakes tried on recordings: direction of the current, kind of the voltage, order
    of the phases.
    """
    p = [record.rest.p for record in events.records]
    v = [record.rest.v for record in events.records]
    turned = f"p at rest would be {-p[0]:.3g}, power taken in" if min(p) > 0 else ""
    rows = [
        OtherReading(
            "the current counted the other way", f"unlikely: {turned}" if turned else _OPEN
        )
    ]
    for words, factor in (
        ("voltages line to line", 1 / np.sqrt(3)),
        ("voltages rms in place of peak", np.sqrt(2)),
    ):
        size = v[0] * factor
        outside = not _USUAL[0] < size < _USUAL[1]
        rows.append(
            OtherReading(
                words, f"excluded: v at rest would be {size:.3g} per unit" if outside else _OPEN
            )
        )
    rows.append(
        OtherReading(
            "two phases of voltage and current swapped",
            "excluded: the positive sequence is the larger one at rest",
        )
    )
    return tuple(rows)
