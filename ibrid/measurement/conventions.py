"""Do the declared conventions hold together? Tests that need no model, and the mistake that a failed one points to."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibrid.measurement.angle_law import angle_reading, contradictions, scale_reason
from ibrid.measurement.noise import PointNoise, estimate
from ibrid.measurement.sweep import PointSweep, Sweep
from ibrid.measurement.tail import inductive_tail

Signs = tuple[int, int]
"""Factors of (p, q) in the low-frequency law that data follow; (1, 1) is the declared convention."""

DECLARED: Signs = (1, 1)
_LAWS: dict[Signs, str] = {
    DECLARED: "-[[p, -q], [-q, -p]]/v^2",
    (-1, -1): "+[[p, -q], [-q, -p]]/v^2",
    (1, -1): "-[[p, q], [q, -p]]/v^2",
    (-1, 1): "+[[p, q], [q, -p]]/v^2",
}
#: Hz above which one operating point alone seems settled by chance: a droop that absorbs power, for one, is not yet.
ALONE_HZ = 4.0
_MATCH = 0.08
_REFUTED = 0.3
_SPAN = 1.25
_SMALLEST_POWER = 0.05
_FACTOR = (0.75, 1.33)
_UNSETTLED = "the lowest frequencies have not settled on the law of an inverter that controls P and Q"


@dataclass(frozen=True)
class Conventions:
    """What the tests say.

    status : "agree" (a test that would have seen a mistake found none), "doubt" (see warnings) or "undecided".
    sentence : the verdict in words, with what could not be tested.
    warnings : the likely mistakes, each a sentence with its reason.
    """

    status: Literal["agree", "doubt", "undecided"]
    sentence: str
    warnings: tuple[str, ...] = ()


def check_conventions(sweep: Sweep, noise: dict[str, PointNoise] | None = None) -> Conventions:
    """Test current direction, q axis, signs of p and q, and scale.

    Law: an inverter that controls P and Q has, with the current counted out of it, Y(0) = -[[p, -q], [-q, -p]] / v^2.
    Each mistake changes signs in it. A verdict needs all operating points to follow one pattern, up to one factor, and
    their lowest points (up to 1.25 times the lowest frequency, two at least) to have settled on it within 8 % plus the
    noise: at a few Hz another pattern often matches unsettled data by chance. Independently, where the highest points
    fall like an inductance, Y = -1 / (j omega L) shows the direction of the current. Where that finds nothing, the law of
    `ibrid.measurement.angle_law` is asked, which holds for any control.

    noise : result of noise.estimate, if already known.
    """
    noise = estimate(sweep) if noise is None else noise
    loaded = [point for point in sweep.points if np.hypot(point.op.p, point.op.q) >= _SMALLEST_POWER]
    matches = [_patterns_followed(point, noise[point.op.name]) for point in loaded]
    common = [signs for signs in _LAWS if matches and all(signs in match for match in matches)]
    tails = [inductive_tail(point, sweep.f0_hz) for point in sweep.points]
    directions = {tail.direction if tail else 0 for tail in tails}
    direction = directions.pop() if len(directions) == 1 else 0  # +1: every tail has the current out, -1: in
    warnings = []
    if common and DECLARED not in common:
        warnings.append(
            f"the lowest frequencies have settled on {_LAWS[common[0]]} instead of {_LAWS[DECLARED]}: "
            f"{_mistake(common[0], direction)}."
        )
    elif direction < 0:
        warnings.append(
            "the highest frequencies fall like an inductance with the current into the inverter: "
            "the current is probably counted the other way than the key current says."
        )
    factor = _common_factor([match[common[0]] for match in matches]) if common else None
    if factor is not None:
        warnings.append(
            f"the lowest frequencies have settled on {factor:.3g} times {_LAWS[common[0]]}: {scale_reason(factor)}."
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


def _patterns_followed(point: PointSweep, noise: PointNoise) -> dict[Signs, float]:
    """The sign patterns on which the lowest points have settled, each with its factor; none if they have not settled.

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
            away = np.linalg.norm(values - factor * law, axis=(1, 2)) / (factor * np.linalg.norm(law))
            distance[signs] = away.min()
            if (away <= tolerance).all():
                followed[signs] = factor
    if followed and DECLARED not in followed and distance.get(DECLARED, np.inf) < _REFUTED:
        followed[DECLARED] = max(followed.values())
    return followed


def _common_factor(factors: list[float]) -> float | None:
    """A factor far from 1 by which all operating points miss the law, if they agree on it within 10 %."""
    middle = float(np.median(factors))
    agree = (np.abs(np.array(factors) / middle - 1) < 0.1).all()
    return middle if agree and not _FACTOR[0] < middle < _FACTOR[1] else None


def _mistake(signs: Signs, direction: int) -> str:
    """What the file most probably has wrong; the direction of the tail tells wrong currents from wrong powers."""
    if signs == (-1, -1):
        current = "the current is counted the other way than the key current says"
        powers = "p and q are what the inverter consumes"
        return {1: powers, -1: current, 0: f"{current}, or {powers}"}[direction]
    if signs == (1, -1):
        return "the q axis points the other way than the key q_axis says, or the sign of q is reversed"
    power = "p is what the inverter consumes"
    both = "current and q axis are both declared the wrong way round"
    swap = "d and q are exchanged"
    return {1: f"{power}, or {swap}", -1: both, 0: f"{power}, or {both}, or {swap}"}[direction]


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
        return Conventions("undecided", f"not decided: {_UNSETTLED}, and the highest do not fall like an inductance.")
    rest = f" ({'; '.join(open_questions)})" if open_questions else ""
    return Conventions("agree", f"no contradiction: {' and '.join(tested)}{rest}.")
