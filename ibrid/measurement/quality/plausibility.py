"""Numbers that cannot be what the file says they are: admittances outside per unit or impedances,
frequencies in rad/s or kHz, parts that were lost.
"""

from collections.abc import Iterator

import numpy as np

from ibrid.measurement.conventions.exchanged_quantity import exchanged_quantity
from ibrid.measurement.conventions.tail import inductive_tail
from ibrid.measurement.quality.angular_frequency import angular_frequencies
from ibrid.measurement.quality.lost_parts import lost_parts
from ibrid.measurement.quality.turned_signs import turned_signs
from ibrid.measurement.sweeps.sweep import Sweep

SMALLEST, LARGEST = 0.1, 300.0
"""|Y| max(1, f / f0) in per unit, 1/x for an inductance: its largest value and its median lie above
and below these for any inverter; in the published parameter sets they are at least 1 and at most
33.
"""
#: Least and largest inductance of a filter, per unit; the published ones have 0.002 to 0.3. Hz from
#: which on it shows, and at which no converter is scanned. By how much the cross entries outweigh
#: the direct ones in an exchanged matrix.
FILTERS, SHOWS_FILTER_HZ, HIGHEST, CROSS = (0.0008, 1.2), 1000.0, 2e5, 2.0
#: What columns are that hold the other quantity.
_HOLDS = "the columns probably hold impedances"
#: Apparent power (per unit) that no inverter delivers.
LARGEST_POWER = 2.0


def implausible_numbers(sweep: Sweep, sampling_hz: float | None = None) -> tuple[str, ...]:
    """Sentences about units that look wrong in every operating point, each with its reason; empty
    if none does.
    """
    rate = sampling_hz or sweep.sampling_hz
    exchanged = tuple(_quantity(sweep))
    units = (
        *_power(sweep),
        *(exchanged or _unit(sweep)),
        *angular_frequencies(sweep),
        *_kilohertz(sweep),
        *_megahertz(sweep),
    )
    return (
        *units,
        *(() if units else _filter(sweep)),
        *_exchanged(sweep),
        *turned_signs(sweep),
        *lost_parts(sweep),
        *_beyond_sampling(sweep, rate),
    )


def _power(sweep: Sweep) -> Iterator[str]:
    beyond = [
        point.op.name
        for point in sweep.points
        if abs(complex(point.op.p, point.op.q)) > LARGEST_POWER
    ]
    if beyond:
        yield (
            f"|p + jq| is above {LARGEST_POWER:g} per unit at {', '.join(beyond[:3])}: p and q are "
            "probably in W or kW, "
            "or on another base; divide them by the rated power."
        )


def _quantity(sweep: Sweep) -> Iterator[str]:
    """Impedances declared as admittances, or the reverse."""
    base = (sweep.s_base_va, sweep.v_base_v)
    z_base = None if base[0] is None or base[1] is None else base[1] ** 2 / base[0]
    shown = exchanged_quantity(sweep.points, sweep.f0_hz, z_base)
    if shown is None:
        return
    size = f" (as such {shown.inductance:.2g} per unit)" if shown.inductance else ""
    capacitor = f"unless the filter has one there (--port), {_HOLDS}" if shown.possible else _HOLDS
    yield (
        "at the highest frequencies |Y| rises like that of a capacitor of "
        f"{shown.susceptance:.2g} per unit at the terminal: {capacitor} where admittances are "
        f"declared, or the reverse, and it is the inductance of a filter{size}; name the columns "
        f"by what they hold, Zdd .. with unit: {shown.unit} (in import --map Zdd=RE+jIM,.. "
        f"--unit {shown.unit})."
    )


def _unit(sweep: Sweep) -> Iterator[str]:
    sizes = [
        np.linalg.norm(point.admittance, axis=(1, 2))
        / np.sqrt(2)
        * np.maximum(1, point.frequency / sweep.f0_hz)
        for point in sweep.points
    ]
    if all(np.median(size) > LARGEST for size in sizes):
        way = "larger"
    elif all(size.max() < SMALLEST for size in sizes):
        way = "smaller"
    else:
        return
    typical = float(
        np.median(
            [np.median(np.linalg.norm(point.admittance, axis=(1, 2))) for point in sweep.points]
        )
    )
    likely = "check unit, s_base_va, v_base_v; kV for V is a factor of a million"
    if way == "smaller" and sweep.s_base_va is None:
        likely = "siemens read as per unit? then add unit: S, s_base_va and v_base_v"
    yield (
        f"|Y| is {typical:.2g} per unit at the median frequency, far {way} than that of any "
        "inverter: "
        f"the unit or the base is probably wrong ({likely})."
    )


def _kilohertz(sweep: Sweep) -> Iterator[str]:
    tails = [inductive_tail(point, sweep.f0_hz, largest=np.inf) for point in sweep.points]
    reactances = [tail.reactance if tail else 0.0 for tail in tails]
    highest = max(point.frequency[-1] for point in sweep.points)
    if highest <= 50 and min(reactances) >= 10:
        yield (
            f"the frequencies look like kHz: the sweep ends at {highest:g} where Y falls like an "
            "inductance of "
            f"{reactances[0]:.0f} per unit at {sweep.f0_hz:g} Hz, a filter has 0.05 to 0.5; "
            "convert freq_hz to Hz."
        )


def _megahertz(sweep: Sweep) -> Iterator[str]:
    highest = max(point.frequency[-1] for point in sweep.points)
    if highest > HIGHEST:
        yield (
            f"the frequencies reach {highest:.3g} Hz, where no converter is scanned: Hz taken as "
            "kHz? Convert freq_hz to Hz."
        )


def _filter(sweep: Sweep) -> Iterator[str]:
    """An inductance of the highest frequencies that no filter has."""
    tails = [inductive_tail(point, sweep.f0_hz, largest=np.inf) for point in sweep.points]
    reactances = [tail.reactance for tail in tails if tail]
    if len(reactances) < len(tails):
        return
    way = (
        "large" if min(reactances) > FILTERS[1] else "small" if max(reactances) < FILTERS[0] else ""
    )
    if way:
        turns = reactances[0] / (2 * np.pi)
        radians = f", Hz taken as rad/s (then {turns:.2g})" if 0.03 <= turns <= 0.6 else ""
        yield (
            f"the highest frequencies look like an inductance of {reactances[0]:.2g} per unit, too "
            f"{way} for a filter (0.03 to "
            f"0.6): check unit and base (pu for S, kVA for MVA{radians}), unless the voltage "
            "feedforward is nearly ideal."
        )


def _exchanged(sweep: Sweep) -> Iterator[str]:
    """High up a filter answers on the axis that is disturbed: Ydd and Yqq outweigh Ydq and Yqd
    there.
    """
    ratios = []
    for point in sweep.points:
        last = point.frequency >= max(point.frequency[-1] / 3, SHOWS_FILTER_HZ)
        size = np.abs(point.admittance[last])
        ratios.append(
            np.median(size[:, [0, 1], [1, 0]]) / np.median(size[:, [0, 1], [0, 1]])
            if last.sum() >= 2
            else 0.0
        )
    if min(ratios) > CROSS:
        yield (
            f"at the highest frequencies Ydq and Yqd are {min(ratios):.2g} times as large as Ydd "
            "and Yqq, as of no filter: two "
            "columns or rows of the matrix are probably exchanged."
        )


def _beyond_sampling(sweep: Sweep, rate: float | None) -> Iterator[str]:
    count = (
        0
        if rate is None
        else sum(int((point.frequency > rate / 2).sum()) for point in sweep.points)
    )
    if rate and count:
        yield (
            f"{count} {'point lies' if count == 1 else 'points lie'} above half the sampling rate "
            f"({rate / 2:g} Hz): "
            "there a digital controller aliases and no averaged model holds, leave them out of a "
            "fit."
        )
