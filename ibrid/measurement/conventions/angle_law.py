"""What the lowest frequencies say of p, q, v, bases, signs and frame, whatever the device contains.

Law: a device at rest has no direction of its own. Turn the grid voltage (V, 0) by a small angle and
wait: the current turns with it, Y(0) (0, V) = J i. So the second column of Y(0) is (q, p)/V^2 of
the power that leaves at the PCC: Ydq V^2 = q, Yqq V^2 = p. It holds for any control of power,
current or voltage, with a PLL or forming the grid, once the angle has settled, which the first
column (what the magnitude does) need not have. p and q counted elsewhere differ by what lies
between: q_pcc = q - L_g |i|^2 + B V^2 behind a grid-side inductance or inside a shunt susceptance.

With constant power at the PCC the first column is (-p, q)/V^2 too: (Yqq - Ydd)/2 reads p, (Ydq +
Yqd)/2 reads q, and (Ydq - Yqd)/2 a shunt susceptance outside. With a constant current the first
column is zero and these read half of p and q.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median_low

import numpy as np

from ibrid.measurement.sweeps.noise import PointNoise
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, PowerNode, Sweep

#: Points up to this multiple of the lowest frequency are extrapolated to zero, and so many at
#: least.
SPAN, FEWEST = 2.0, 3
#: Largest part of a reading that has not settled at the lowest frequency.
UNSETTLED = 0.2
#: Hz above which one operating point alone seems settled by chance: a droop that absorbs power, for
#: one, is not yet.
ALONE_HZ = 4.0
#: Least p that is worth comparing.
LOADED = 0.1
#: |ln| of a scale that losses and a reading without doubt may show, and how far the operating
#: points may differ in it.
CLOSE, ALIKE = 0.12, 0.1
#: Power (per unit) by which a point that agrees may be off, losses and its node among it.
ODD = 0.15
#: Ratio of doubts below which one reading is preferred to another; distance in p + jq within which
#: a reading agrees.
RATHER, AGREES = 0.5, 0.03
#: Least range of q over the operating points that tells on which side the q axis is.
MIRRORED = 0.2
#: Inductance (pu) that p, q of the PCC cannot have behind them, and the largest reactive power of
#: branches outside p, q.
OWN_NODE, OUTSIDE = 0.03, 0.4
#: |ln| within which a scale is taken for a usual mistake.
NEAR, FITTED = 0.1, 0.04
_UNKNOWN = PointNoise("unknown", None, None)
_MISTAKES = (
    (2**0.5, "peak and rms values confused (sqrt 2)"),
    (3**0.5, "line and phase values confused (sqrt 3)"),
    (1.5, "the factor 3/2 of the Park transformation"),
    (
        1.5**0.5,
        "voltages and currents by two Park transformations, with 2/3 and with sqrt(2/3) "
        "(sqrt(3/2))",
    ),
    (2.0, "peak and rms values confused in voltage and current (2)"),
    (3.0, "impedances three times too {impedance}, line for phase values"),
)


@dataclass(frozen=True)
class AngleReading:
    """`power` : p + jq as the angle law reads them at the PCC, with the v of the label.

    `doubt` : by how much of its magnitude it may be wrong: noise, and what has not settled.
    """

    point: PointSweep
    power: complex
    doubt: float

    def off(self, power: complex) -> float:
        """Per unit, by how much another p + jq differs from this one beyond doubt."""
        return abs(self.power - power) - self.doubt * abs(self.power)


def angle_reading(point: PointSweep, noise: PointNoise) -> AngleReading | None:
    """The reading at one operating point; None where the angle has not settled at the lowest
    frequencies.

    Real parts are even in frequency and imaginary ones odd, so Re = a + b f^2 and Im = c f up to
    terms of a higher order; a is what is read, and both other terms at the lowest frequency say how
    far from rest that is.
    """
    lowest = point.frequency <= SPAN * point.frequency[0]
    lowest[:FEWEST] = point.frequency[:FEWEST] <= SPAN**2 * point.frequency[0]
    frequency = point.frequency[lowest] / point.frequency[0]
    if len(frequency) < FEWEST:
        return None
    at_rest, moving, left = column_at_rest(frequency, point.admittance[lowest][:, :, 1])
    size = float(np.linalg.norm(at_rest))
    if not size:
        return None
    level = 0.0
    if noise.relative is not None:
        absolute = noise.relative[lowest] * np.linalg.norm(point.admittance[lowest], axis=(1, 2))
        level = float(np.median(absolute) / np.sqrt(2) / size / np.sqrt(len(frequency)))
    if moving > UNSETTLED + 2 * level:
        return None
    return AngleReading(
        point, complex(at_rest[1], at_rest[0]) * point.op.v**2, moving + left + 4 * level
    )


def exchanged_diagonal(
    sweep: Sweep, noise: Mapping[str, PointNoise], *, beside_axes: bool = False
) -> str:
    """A sentence where (Ydq, Ydd) has settled on (q, p)/v^2 at every operating point while (Ydq,
    Yqq) has not, nor on that of the opposite p; "" elsewhere.

    beside_axes : required is a smaller doubt than that of exchanged d and q axes, (Yqd, Ydd).
    """
    if len(sweep.points) == 1 and sweep.points[0].frequency[0] > ALONE_HZ:
        return ""
    for point in sweep.points:
        admittance = np.where(np.eye(2), point.admittance[:, ::-1, ::-1], point.admittance)
        level, power = noise[point.op.name], complex(point.op.p, point.op.q)
        other = angle_reading(PointSweep(point.op, point.frequency, admittance), level)
        own = angle_reading(point, level)
        if abs(power.real) < LOADED or other is None or other.off(power) > ODD:
            return ""
        settled = None if own is None or RATHER * own.doubt >= other.doubt else own
        if settled and min(map(settled.off, (power, -power.conjugate()))) < 2 * ODD:
            return ""
        swapped = PointSweep(point.op, point.frequency, point.admittance[:, ::-1, ::-1])
        axes = angle_reading(swapped, level) if beside_axes else None
        if axes is not None and other.doubt > RATHER * axes.doubt:
            return ""
    return (
        "the lowest frequencies show p in Ydd, where a device that turns with the voltage has it "
        "in Yqq: Ydd and Yqq are probably exchanged."
    )


def column_at_rest(frequency: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, float, float]:
    """A column of Y (K, 2) at zero frequency (2,), and as parts of it: what moves at the lowest
    frequency, and what Re = a + b f^2, Im = c f leave of the real part; infinite of zero.

    frequency : (K,) over the lowest.
    """
    basis = np.stack([np.ones_like(frequency), frequency**2], axis=1)
    at_rest, bend = np.linalg.lstsq(basis, np.real(column), rcond=None)[0]
    slope = np.linalg.lstsq(frequency[:, None], np.imag(column), rcond=None)[0][0]
    size = float(np.linalg.norm(at_rest))
    if not size:
        return at_rest, np.inf, np.inf
    left = float(np.linalg.norm(np.real(column) - basis @ [at_rest, bend], axis=1).max())
    return at_rest, float(np.linalg.norm(bend) + np.linalg.norm(slope)) / size, left / size


def contradictions(
    readings: Sequence[AngleReading], direction: int, power_node: PowerNode
) -> tuple[str, ...]:
    """Labels that the angle law contradicts at every operating point alike, or at some while it
    agrees at others, each a sentence that names the likely mistake.

    direction : +1 where the highest frequencies show the current out of the inverter, -1 into it, 0
    where they do not tell.
    """
    declared = [one.off(complex(one.point.op.p, one.point.op.q)) for one in readings]
    exchanged = [one.off(complex(one.point.op.q, one.point.op.p)) for one in readings]
    if readings and max(exchanged) < ODD and max(declared) > 2 * ODD:
        return (
            "the lowest frequencies show p where the file has q, and q where it has p: they are "
            "probably exchanged.",
        )
    loaded = [one for one in readings if abs(one.point.op.p) >= LOADED]
    factors = np.array([one.power.real / one.point.op.p for one in loaded])
    if set(np.sign(factors)) not in ({1}, {-1}):
        return ()
    mistakes, factor = [], float(np.sign(factors[0]))
    if factor < 0:
        mistakes += [
            "the lowest frequencies show power that flows the other way than p says: "
            f"{_REVERSED[direction]}."
        ]
    off, doubt = np.log(np.abs(factors)), np.array([one.doubt for one in loaded])
    beyond = np.abs(off) > CLOSE + doubt / 2
    if beyond.all() and len(set(np.sign(off))) == 1 and np.ptp(off) < ALIKE + doubt.max():
        scale = float(np.exp(np.median(off)))
        factor *= scale
        if turned := _turned_impedance(loaded):
            return (turned,)
        mistakes.append(
            f"the lowest frequencies show {scale:.2g} times the p of the file at every operating "
            f"point: {scale_reason(scale)}."
        )
    reactive = _reactive(loaded, factor, power_node)
    mistakes += [] if reactive is None else [reactive]
    return tuple(mistakes or _odd(readings, declared))


def _turned_impedance(loaded: Sequence[AngleReading]) -> str:
    """A sentence with the entries of Z, one or either of two, with whose sign turned all points
    read their p and q; "" for none or more.
    """
    if any((np.linalg.det(one.point.admittance) == 0).any() for one in loaded):
        return ""
    turned = [entry for entry in ENTRIES if all(_agrees_turned(one.point, entry) for one in loaded)]
    if not 1 <= len(turned) <= 2:
        return ""
    named = " or ".join(f"Z{entry}" for entry in turned)
    return (
        f"the lowest frequencies agree with p and q once the sign of {named} is turned: it is "
        "probably wrong in the file; correct it there."
    )


def _agrees_turned(point: PointSweep, entry: str) -> bool:
    """Whether an operating point reads its p and q once the sign of an entry of Z is turned."""
    impedance = np.linalg.inv(point.admittance)
    impedance[(slice(None), *ENTRIES[entry])] *= -1
    mended = PointSweep(point.op, point.frequency, np.linalg.inv(impedance))
    reading = angle_reading(mended, _UNKNOWN)
    return reading is not None and reading.off(complex(point.op.p, point.op.q)) < AGREES


def _odd(readings: Sequence[AngleReading], off: Sequence[float]) -> Iterator[str]:
    """Points that are far off what they declare while at least as many agree."""
    for one, far in zip(readings, off, strict=True):
        if far > 2 * ODD and median_low(off) < ODD:
            op, read = one.point.op, one.power
            yield (
                f"the lowest frequencies show p = {read.real:.2g}, q = {read.imag:.2g} at "
                f"{op.name}, where the file has {op.p:g} "
                f"and {op.q:g}, and agree with it at other points: the label of this one is "
                "probably wrong."
            )


_ON_Q = "the voltage at rest lies on q (# voltage_axis: q)"
_REVERSED = {
    1: f"p and q are what the inverter consumes, or {_ON_Q}, or Ydd and Yqq are exchanged",
    -1: "the current is counted the other way than the key current says",
    0: "the current is counted the other way than the key current says, or p and q are what the "
    "inverter consumes, or " + _ON_Q,
}


def scale_reason(factor: float) -> str:
    """What makes admittances say `factor` times the power of the labels: every usual mistake that
    is near, the nearest first.
    """
    likely = " or ".join(_near(factor, NEAR)).format(impedance="large" if factor < 1 else "small")
    size = f"{1 / factor:.3g} times too large" if factor < 1 else f"{factor:.3g} times too small"
    return (
        f"p and q are probably {size}{f', by {likely}' if likely else ''}; or v is wrong by the "
        "square root of that, or the "
        "unit or the base (s_base_va, v_base_v) of Y"
    )


def usual_mistakes(scale: float) -> str:
    """ ", as by ..." for a scale that was found by a fit, where it is within `FITTED` of one that a
    usual mistake makes.
    """
    named = [words for words in _near(scale, FITTED) if "{" not in words]
    return f", as by {' or '.join(named)}" if named else ""


def _near(scale: float, within: float) -> list[str]:
    away = sorted((abs(abs(np.log(scale)) - np.log(size)), words) for size, words in _MISTAKES)
    return [words for distance, words in away if distance < within]


def _reactive(loaded: Sequence[AngleReading], factor: float, power_node: PowerNode) -> str | None:
    """What is wrong with q, its axis, its node or the frame, once scale and direction of the power
    are put right.
    """
    ops = [one.point.op for one in loaded]
    q, read = np.array([op.q for op in ops]), np.array([one.power.imag / factor for one in loaded])
    current = np.array([abs(one.power / factor) / one.point.op.v for one in loaded])
    doubt = np.array([one.doubt * abs(one.power / factor) for one in loaded]) / 2
    straight, mirrored = read - q, read + q
    agree = (np.abs(mirrored - np.median(mirrored)) < MIRRORED / 2 + doubt).all()
    if np.ptp(q) > MIRRORED and agree and np.ptp(mirrored) < np.ptp(straight) / 4:
        return (
            "the lowest frequencies show the opposite of q: the q axis points the other way than "
            "the key q_axis says, or the "
            "sign of q is reversed."
        )
    turned = np.degrees(np.median(straight / np.array([2 * op.p for op in ops])))
    frame = f"the measuring frame is turned by about {turned:.2g} degrees"
    behind = (
        -straight / current**2
    )  # the inductance between the node of p, q and the PCC that would explain it
    if power_node == "pcc" and (-straight > OWN_NODE * current**2 + doubt).all():
        return (
            f"the lowest frequencies show {np.median(-straight):.2g} less reactive power than q: p "
            "and q were probably "
            f"measured behind {np.median(behind):.2g} of inductance (write # power_node: "
            f"capacitor), or {frame}."
        )
    if (np.abs(straight) > OUTSIDE + doubt).all() and len(set(np.sign(straight))) == 1:
        return (
            f"the lowest frequencies show {np.median(straight):+.2g} of reactive power beside q: "
            f"{frame}, or q leaves out what "
            "lies between its node and the PCC (--port)."
        )
    return None
