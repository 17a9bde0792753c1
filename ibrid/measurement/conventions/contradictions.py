"""Do the declared conventions hold together? Tests that need no model, and the mistake that a
failed one points to.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibrid.border import takes_kinds
from ibrid.measurement.conventions.angle_law import (
    ALONE_HZ,
    angle_reading,
    contradictions,
    exchanged_diagonal,
    scale_reason,
)
from ibrid.measurement.conventions.frame_angle import TurnedFrame, turned_frame
from ibrid.measurement.conventions.frequency_base import (
    FrequencyReading,
    contradicting_readings,
    other_frequency,
)
from ibrid.measurement.conventions.resting_axis import RestingAxis, resting_axis
from ibrid.measurement.conventions.rotation import half_turn
from ibrid.measurement.conventions.tail import inductive_tail
from ibrid.measurement.conventions.units_of_entries import units_of_entries
from ibrid.measurement.sweeps.noise import PointNoise, estimate
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep

Signs = tuple[int, int]
"""Factors of (p, q) in the low-frequency law that data follow; (1, 1) is the declared convention.
"""

DECLARED: Signs = (1, 1)
_LAWS: dict[Signs, str] = {
    DECLARED: "-[[p, -q], [-q, -p]]/v^2",
    (-1, -1): "+[[p, -q], [-q, -p]]/v^2",
    (1, -1): "-[[p, q], [q, -p]]/v^2",
    (-1, 1): "+[[p, q], [q, -p]]/v^2",
}
_ON_Q = "the voltage at rest lies on q (# voltage_axis: q)"
_MATCH = 0.08
_REFUTED = 0.3
_SPAN = 1.25
_SMALLEST_POWER = 0.05
_FACTOR = (0.75, 1.33)
_UNSETTLED = (
    "the lowest frequencies have not settled on the law of an inverter that controls P and Q"
)


@dataclass(frozen=True)
class Conventions:
    """What the tests say.

    status : "agree" (a test that would have seen a mistake found none), "doubt" (see warnings) or
    "undecided".
    sentence : the verdict in words, with what could not be tested.
    warnings : the likely mistakes, each a sentence with its reason.
    """

    status: Literal["agree", "doubt", "undecided"]
    sentence: str
    warnings: tuple[str, ...] = ()


@takes_kinds
def check_conventions(sweep: Sweep, noise: dict[str, PointNoise] | None = None) -> Conventions:
    """Test the nominal frequency (`ibrid.measurement.conventions.frequency_base`), then what
    `check_directions` tests.

    noise : result of noise.estimate, if already known.
    """
    noise = estimate(sweep) if noise is None else noise
    directions = check_directions(sweep, noise)
    sentence = _frequency_doubt(contradicting_readings(sweep, noise), sweep.f0_hz)
    if sentence is None:
        return directions
    warnings = (sentence, *directions.warnings)
    return Conventions("doubt", f"they do not hold together: {sentence}", warnings)


def _frequency_doubt(readings: Sequence[FrequencyReading], f0_hz: float) -> str | None:
    """The nominal frequency that every operating point shows in place of that of the file."""
    other = other_frequency(readings, f0_hz)
    if other is None:
        return None
    usual, mean = other
    doubt = max(one.doubt for one in readings)
    lowest = max(one.lowest for one in readings)
    part = 1 - usual / f0_hz
    twin = (
        f"a decoupling of {part:.0%} of its inductance"
        if part > 0
        else "a decoupling of the wrong sign"
    )
    return (
        f"above {lowest / 1e3:.2g} kHz the impedance turns as that of a filter at f0 = {mean:.1f} "
        f"+- {doubt:.1g} Hz, not at "
        f"{f0_hz:g} Hz: f0_hz is probably {usual:g} (write # f0_hz: {usual:g}); {twin} without "
        "delay would look alike."
    )


def check_directions(sweep: Sweep, noise: dict[str, PointNoise] | None = None) -> Conventions:
    """Test current direction, q axis, axis of the voltage, signs of p and q, and scale.

    Law: an inverter that controls P and Q has, with the current counted out of it, Y(0) = -[[p,
    -q], [-q, -p]] / v^2. Each mistake changes signs in it. A verdict needs all operating points to
    follow one pattern, up to one factor, and their lowest points (up to 1.25 times the lowest
    frequency, two at least) to have settled on it within 8 % plus the noise: at a few Hz another
    pattern often matches unsettled data by chance. Independently, where the highest points fall
    like an inductance, Y = -1 / (j omega L) shows the direction of the current. Where that finds
    nothing, the law of `ibrid.measurement.conventions.angle_law` is asked, which holds for any
    control. Where the voltage at rest is seen on q (`ibrid.measurement.conventions.resting_axis`),
    or the frame is seen turned (`frame_angle`), all of these look at the wrong axis, and that alone
    is said.

    noise : result of noise.estimate, if already known.
    """
    if sentence := units_of_entries(sweep):
        return Conventions("doubt", f"they do not hold together: {sentence}", (sentence,))
    noise = estimate(sweep) if noise is None else noise
    axis = resting_axis(sweep, noise)
    if axis is not None and axis.axis == "q":
        warning = exchanged_diagonal(sweep, noise, beside_axes=True) or _on_q(axis)
        return Conventions("doubt", f"they do not hold together: {warning}", (warning,))
    matches = _matches(sweep.points, noise)
    common = _common(matches)
    tails = [inductive_tail(point, sweep.f0_hz) for point in sweep.points]
    directions = {tail.direction if tail else 0 for tail in tails}
    direction = (
        directions.pop() if len(directions) == 1 else 0
    )  # +1: every tail has the current out, -1: in
    warnings = []
    if not common and (
        sentence := exchanged_diagonal(sweep, noise) or _turned_entry(sweep.points, noise)
    ):
        return Conventions("doubt", f"they do not hold together: {sentence}", (sentence,))
    frame = None if common else turned_frame(sweep, noise)
    if frame is not None:
        sentence = _turned(frame, sweep)
        return Conventions("doubt", f"they do not hold together: {sentence}", (sentence,))
    if common and DECLARED not in common:
        warnings.append(
            f"the lowest frequencies have settled on {_LAWS[common[0]]} instead of "
            f"{_LAWS[DECLARED]}: "
            f"{_mistake(common[0], direction)}."
        )
    elif direction < 0 and common and axis is None:
        warnings.append(
            "the highest frequencies fall like an inductance with the current into the inverter, "
            "the lowest have settled on "
            f"{_LAWS[DECLARED]} as with the current out: the current is probably counted the other "
            "way than the key current "
            "says, and either the voltage at rest lies on q (# voltage_axis: q), or p and q are "
            "what the inverter consumes."
        )
    elif direction < 0:
        warnings.append(
            "the highest frequencies fall like an inductance with the current into the inverter: "
            "the current is probably counted the other way than the key current says."
        )
    factor = _common_factor([match[common[0]] for match in matches]) if common else None
    if factor is not None:
        warnings.append(
            f"the lowest frequencies have settled on {factor:.3g} times {_LAWS[common[0]]}: "
            f"{scale_reason(factor)}."
        )
    if not warnings:
        readings = [angle_reading(point, noise[point.op.name]) for point in sweep.points]
        settled = [one for one in readings if one is not None]
        alone = len(readings) == 1 and sweep.points[0].frequency[0] > ALONE_HZ
        if len(settled) == len(readings) and not alone:
            warnings += contradictions(settled, direction, sweep.power_node)
    if warnings:
        return Conventions("doubt", f"they do not hold together: {warnings[0]}", tuple(warnings))
    return _without_complaint(common, direction)


def seen_frame(sweep: Sweep, noise: dict[str, PointNoise]) -> TurnedFrame | None:
    """The frame that the lowest frequencies show turned, where neither another axis nor another
    sign explains them.
    """
    axis = resting_axis(sweep, noise)
    if (axis is not None and axis.axis == "q") or _common(_matches(sweep.points, noise)):
        return None
    return turned_frame(sweep, noise)


def _matches(
    points: Sequence[PointSweep], noise: dict[str, PointNoise]
) -> list[dict[Signs, float]]:
    """The patterns that each loaded point follows."""
    loaded = [point for point in points if np.hypot(point.op.p, point.op.q) >= _SMALLEST_POWER]
    return [_patterns_followed(point, noise[point.op.name]) for point in loaded]


def _turned_entry(points: Sequence[PointSweep], noise: dict[str, PointNoise]) -> str:
    """A sentence where all points have settled on the declared law once the sign of one entry of Y
    is turned, which no other convention does; "" elsewhere.
    """
    for entry, place in ENTRIES.items():
        turned = []
        for point in points:
            admittance = point.admittance.copy()
            admittance[(slice(None), *place)] *= -1
            turned.append(PointSweep(point.op, point.frequency, admittance))
        matches = _matches(turned, noise)
        if matches and all(DECLARED in match for match in matches):
            return (
                f"the lowest frequencies have settled on {_LAWS[DECLARED]} once the sign of "
                f"Y{entry} is turned: it is probably wrong in the file; correct it there."
            )
    return ""


def _common(matches: list[dict[Signs, float]]) -> list[Signs]:
    """The patterns that all of them follow."""
    return [signs for signs in _LAWS if matches and all(signs in match for match in matches)]


def _patterns_followed(point: PointSweep, noise: PointNoise) -> dict[Signs, float]:
    """The sign patterns on which the lowest points have settled, each with its factor; none if they
    have not settled.

    The declared one is counted in when it is not clearly worse (q near 0 cannot tell the q axis).
    """
    lowest = point.frequency <= _SPAN * point.frequency[0]
    lowest[:2] = True
    values = point.admittance[lowest]
    if len(values) < 2:
        return {}
    level = 0.0 if noise.relative is None else float(np.median(noise.relative[lowest]))
    tolerance = min(_MATCH + 2 * level, _REFUTED / 2)
    followed, distance = {}, {}
    for signs in _LAWS:
        p, q = point.op.p * signs[0], point.op.q * signs[1]
        law = -np.array([[p, -q], [-q, -p]]) / point.op.v**2
        factor = float(np.real(np.vdot(law, values.mean(axis=0)))) / float(np.linalg.norm(law)) ** 2
        if factor > 0:
            away = np.linalg.norm(values - factor * law, axis=(1, 2)) / (
                factor * np.linalg.norm(law)
            )
            distance[signs] = away.min()
            if (away <= tolerance).all():
                followed[signs] = factor
    if followed and DECLARED not in followed and distance.get(DECLARED, np.inf) < _REFUTED:
        followed[DECLARED] = max(followed.values())
    return followed


def _common_factor(factors: list[float]) -> float | None:
    """A factor far from 1 by which all operating points miss the law, if they agree on it within 10
    %.
    """
    middle = float(np.median(factors))
    agree = (np.abs(np.array(factors) / middle - 1) < 0.1).all()
    return middle if agree and not _FACTOR[0] < middle < _FACTOR[1] else None


def _mistake(signs: Signs, direction: int) -> str:
    """What the file most probably has wrong; the direction of the tail tells wrong currents from
    wrong powers.
    """
    if signs == (-1, -1):
        current = "the current is counted the other way than the key current says"
        powers = f"p and q are what the inverter consumes, or {_ON_Q}"
        return {1: powers, -1: current, 0: f"{current}, or {powers}"}[direction]
    if signs == (1, -1):
        return (
            "the q axis points the other way than the key q_axis says, or the sign of q is reversed"
        )
    power = "p is what the inverter consumes"
    both = "current and q axis are both declared the wrong way round"
    swap = "d and q are exchanged (# voltage_axis: q and # q_axis: lags), or Ydd and Yqq alone are"
    return {1: f"{power}, or {swap}", -1: both, 0: f"{power}, or {both}, or {swap}"}[direction]


def _on_q(axis: RestingAxis) -> str:
    """What to write where the voltage at rest is seen on q."""
    keys = ["# voltage_axis: q (d where it says q)"]
    keys += (
        ["# current: in (out where it says in) if p is what the inverter delivers"]
        if axis.sign < 0
        else []
    )
    keys += ["# q_axis: lags (leads where it says lags) if q is"] if axis.side < 0 else []
    frame = "d and q are exchanged" if axis.side < 0 else "a frame at +-90 degrees"
    return (
        "the lowest frequencies show the voltage at rest on the q axis: the first column of Y "
        "stays at the current at rest, "
        f"turned with the voltage, while the second moves ({frame}); write {' and '.join(keys)}."
    )


def _turned(frame: TurnedFrame, sweep: Sweep) -> str:
    """What to write where the frame is seen turned."""
    degrees = [f"{np.degrees(angle):.0f}" for angle in frame.angles]
    points = zip(sweep.names, degrees, strict=False)
    about = (
        degrees[0]
        if len(degrees) == 1
        else ", ".join(f"{angle} at {name}" for name, angle in points)
    )
    own = ", as that of the grid's source or of a fixed reference is" if len(degrees) > 1 else ""
    keys = [f"# frame_deg: {', '.join(degrees)}"]
    quarter = ", ".join(f"{np.degrees(half_turn(angle + np.pi / 2)):.0f}" for angle in frame.angles)
    twin = (
        f"; or # frame_deg: {quarter} and # current: in (out where it says in)"
        if frame.twin
        else ""
    )
    keys += ["# current: in (out where it says in)"] if frame.sign < 0 else []
    keys += ["# q_axis: lags (leads where it says lags)"] if frame.side < 0 else []
    return (
        "the lowest frequencies rest on p and q in another frame than that of the voltage: the "
        "measuring frame is turned by "
        f"about {about} degrees (+-{max(np.degrees(frame.doubt), 1):.0f}){own}; write "
        f"{' and '.join(keys)}{twin}."
    )


def _without_complaint(common: list[Signs], direction: int) -> Conventions:
    tested, open_questions = [], []
    if common:
        tested.append(f"the lowest frequencies have settled on {_LAWS[DECLARED]}")
        if (1, -1) in common:
            open_questions.append("q is too small to test the q axis")
    else:
        open_questions.append(f"q axis and scale are not tested, {_UNSETTLED}")
    if direction > 0:
        tested.append("the highest fall like an inductance with the current out of the inverter")
    if not tested:
        return Conventions(
            "undecided",
            f"not decided: {_UNSETTLED}, and the highest do not fall like an inductance.",
        )
    rest = f" ({'; '.join(open_questions)})" if open_questions else ""
    return Conventions("agree", f"no contradiction: {' and '.join(tested)}{rest}.")
