"""Which way the current of a foreign table counts, on which side its q axis lies and on which axis
its voltage at rest.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.contradictions import check_directions, seen_frame
from ibrid.measurement.conventions.conversions import TO_SEQUENCE
from ibrid.measurement.conventions.header import CHOICES
from ibrid.measurement.conventions.resting_axis import resting_axis
from ibrid.measurement.conventions.rotation import half_turn
from ibrid.measurement.conventions.tail import signs_of_tail
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.foreign_part import Part
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account, number_said
from ibrid.measurement.sweeps.noise import estimate
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

#: What is asked; if what the usual reading of the lowest frequencies holds; and what another
#: reading of them may be.
DIRECTIONS = {
    "current": "which way the current counts",
    "q_axis": "on which side q lies",
    "voltage_axis": "on which axis the voltage at rest lies",
}
_RIGHT = {
    "current": "p is what the inverter delivers",
    "q_axis": "q has the sign of what the inverter delivers",
}
_UNUSUAL = {
    "current": "by the lowest frequencies into the inverter, or p and q are what it consumes",
    "q_axis": "by the lowest frequencies behind d, or the sign of q is reversed",
    "voltage_axis": "by the lowest frequencies on q, or p and q are what the inverter consumes",
}
_UNSEEN = "the frequencies do not show it; d in most programs"
_WHERE_UNSEEN = "where the frequencies do not show it"
#: What makes a direction that is said look like the other one.
_CAUSES = {
    "current": ", as where all signs are turned",
    "q_axis": ", as where the columns of Ydq and Yqd are exchanged, or one sign is turned",
}
#: What looks like a direction that the highest frequencies show.
_TWINS = {"lags": ", unless the columns of Ydq and Yqd are exchanged, which looks alike there"}
#: Nominal frequency where nobody says it yet, Hz: what is asked of the highest frequencies hardly
#: depends on it.
_USUAL_HZ = 50.0
_MAYBE_UNSEEN = "where the frequencies do not show it; d in most programs"


def names_q_first(table: ForeignTable) -> bool:
    """True where qq stands before dd, as in scans with axes qd0, whose voltage often lies on q."""
    entries = [meaning_of(name).entry for name in table.columns]
    return "qq" in entries and "dd" in entries and entries.index("qq") < entries.index("dd")


def directions_of(
    made: Callable[..., Sweep],
    told: Mapping[str, Any],
    sequence: bool,
    q_first: bool,
    account: Account,
) -> tuple[str, ...]:
    """Which way the current counts, on which side q lies and on which axis the voltage: as said,
    else as the data show, else asked.

    Laws: high up a filter is an inductance, whose sign and turn show the first two. Low down the
    power of an inverter that controls it stays (conventions.check_directions), where another
    current or axis looks like another sign of p and q, or of q: what the lowest frequencies show is
    taken where it is the usual, and asked for where either of two single mistakes explains it.
    Where the lowest frequencies do not rest, a frame at 90 degrees, or d and q exchanged, shows in
    nothing: the axis of the voltage is asked for, unless something is said about the directions;
    then it is d if no name speaks for q.
    """
    choices = {key: (str(told[key]),) if told.get(key) else CHOICES[key] for key in DIRECTIONS}
    any_said = says_directions(told)
    possible = dict.fromkeys(DIRECTIONS, slice(2)) | (
        dict.fromkeys(("q_axis", "voltage_axis"), slice(1)) if sequence else {}
    )
    choices = {key: words[possible[key]] for key, words in choices.items()}
    plain = made(*(CHOICES[key][0] for key in DIRECTIONS))
    seen = zip(*(signs_of_tail(point, plain.f0_hz) for point in plain.points), strict=True)
    for key, signs in zip(("current", "q_axis"), map(set, seen), strict=True):
        if len(choices[key]) > 1 and signs in ({1}, {-1}):
            choices[key] = CHOICES[key][:1] if signs == {1} else CHOICES[key][1:]
            twin = _TWINS.get(choices[key][0], "")
            account.remark(f"{key}: {choices[key][0]}, as the highest frequencies show{twin}")
        elif told.get(key) and signs in ({1}, {-1}):
            shown = CHOICES[key][0] if signs == {1} else CHOICES[key][1]
            if shown != choices[key][0]:
                account.remark(
                    f"{key}: {choices[key][0]} as said, while the highest frequencies show {shown}"
                    f"{_CAUSES[key]}"
                )
    readings = list(product(*choices.values()))
    if len(readings) > 1:
        noise = estimate(plain)
        every = product(*(CHOICES[key][possible[key]] for key in DIRECTIONS))
        sound = [
            reading
            for reading in every
            if check_directions(made(*reading), noise).status != "doubt"
        ]
        readings = [reading for reading in readings if reading in sound] or sound or readings
        readings = _by_voltage(
            readings,
            choices["voltage_axis"],
            resting_axis(plain, noise) is not None,
            q_first,
            any_said,
            account,
        )
    for key, left in zip(choices, map(set, zip(*readings, strict=True)), strict=True):
        if len(choices[key]) == 1 or key == "voltage_axis":
            continue
        usual, other = (f"--{key.replace('_', '-')} {word}" for word in choices[key])
        if left == {choices[key][0]}:
            account.remark(
                f"{key}: {choices[key][0]}, as the lowest frequencies show if {_RIGHT[key]} (else "
                f"{other})"
            )
        elif key != "current" or not _asks_beside_frame(account):
            account.ask(DIRECTIONS[key] + f" ({_UNUSUAL[key]})" * (len(left) == 1), usual, other)
    return tuple(
        word[0] if len(word) == 1 else first
        for word, first in zip(choices.values(), readings[0], strict=True)
    )


def _asks_beside_frame(account: Account) -> bool:
    """Whether the question for the angle of the frame asks for the way of the current too."""
    return any("--frame-deg" in one and "--current" in one for one in map(str, account.questions))


def says_directions(told: Mapping[str, Any]) -> bool:
    """Whether anything is said of the current, the side of q, the axis of the voltage or the angle
    of the frame.
    """
    return any(told.get(key) for key in (*DIRECTIONS, "frame_deg"))


def ask_of_directions(parts: Sequence[Part], account: Account) -> None:
    """Ask for what the frequencies may not show, together with what else is asked: the axis of the
    voltage, and the way of the current and the side of q where the highest do not look like an
    inductance.
    """
    told, sequence = parts[0].told, parts[0].counting.frame != "dq"
    if not sequence and not any(says_directions(part.told) for part in parts):
        account.ask(
            f"{DIRECTIONS['voltage_axis']} ({_MAYBE_UNSEEN})",
            "--voltage-axis d",
            "--voltage-axis q",
        )
    if parts[0].counting.frame == "positive" or says_directions(told):
        return
    current, side = _tail_of(parts[0])
    if not current:
        account.ask(
            f"{DIRECTIONS['current']} ({_WHERE_UNSEEN}; in or out of the device)",
            "--current out",
            "--current in",
        )
    if not side and not sequence:
        account.ask(
            f"{DIRECTIONS['q_axis']} ({_WHERE_UNSEEN}; behind d in PSCAD)",
            "--q-axis leads",
            "--q-axis lags",
        )


def _tail_of(part: Part) -> tuple[int, int]:
    """`signs_of_tail` of the first operating point of a part, whatever its unit; (0, 0) where it
    has no such point.
    """
    f0_hz = number_said(part.told.get("f0_hz")) or _USUAL_HZ
    frequency = part.frequency - f0_hz * (part.counting.network and part.counting.frame == "pn")
    rows = np.flatnonzero((part.names == part.names[0]) & (frequency > 0))
    frequency, first = np.unique(frequency[rows], return_index=True)
    matrix = part.matrix[rows[first]]
    if part.counting.frame == "pn":
        matrix = np.conj(TO_SEQUENCE.T) @ matrix @ TO_SEQUENCE
    try:
        with np.errstate(all="ignore"):
            admittance = np.linalg.inv(matrix) if part.quantity.letter == "Z" else matrix
        return signs_of_tail(
            PointSweep(OperatingPoint("point", 0.0, 0.0), frequency, admittance), f0_hz, np.inf
        )
    except (SweepError, np.linalg.LinAlgError):
        return 0, 0


def frame_of(plain: Sweep, current_said: bool, account: Account) -> tuple[float, ...]:
    """Degrees by which the lowest frequencies show the measuring frame turned, which is asked for,
    else none.

    plain : in the directions that are said, else in the usual ones.
    """
    frame = seen_frame(plain, estimate(plain))
    if frame is None:
        return (0.0,)
    degrees = tuple(round(float(np.degrees(angle))) for angle in frame.angles)
    shown = ",".join(map(str, degrees))
    words = (
        "by which angle the measuring frame is turned (by the lowest frequencies about "
        f"{shown.replace(',', ', ')} degrees)"
    )
    quarters = [round(float(np.degrees(half_turn(one + np.pi / 2)))) for one in frame.angles]
    quarter = ",".join(map(str, quarters))
    into = frame.sign < 0 and not current_said
    answers = [f"--frame-deg {shown}{' --current in' * into}"]
    if frame.twin and not current_said:
        answers.append(f"--frame-deg {quarter}{' --current in' * (not into)}")
    if into:
        words += f", and {DIRECTIONS['current']} ({_UNUSUAL['current']})"
        answers.append(f"--frame-deg {shown} --current out")
    account.ask(words, *answers, "--frame-deg 0")
    return degrees


def _by_voltage(
    readings: list[tuple[str, ...]],
    choices: tuple[str, ...],
    seen: bool,
    q_first: bool,
    any_said: bool,
    account: Account,
) -> list[tuple[str, ...]]:
    """The readings with the voltage at rest on the axis that is left of d and q, else on d.

    Asked for where names or the highest frequencies speak for q, and where both are left and nobody
    said a direction.
    seen : the lowest frequencies show the axis. any_said : which way the current counts, or where q
    lies, is said.
    """
    left = {reading[-1] for reading in readings}
    if len(choices) == 1:
        return readings
    if left == {"q"} and seen:
        account.remark("voltage_axis: q, as the lowest frequencies show (else --voltage-axis d)")
    elif left == {"q"} or (len(left) > 1 and (q_first or not any_said)):
        why = "its names have q before d, as scans with the voltage on q do" if q_first else _UNSEEN
        account.ask(
            f"{DIRECTIONS['voltage_axis']} ({_UNUSUAL['voltage_axis'] if left == {'q'} else why})",
            "--voltage-axis d",
            "--voltage-axis q",
        )
    elif len(left) > 1:
        account.remark("the voltage at rest taken on d (else --voltage-axis q)")
    return [reading for reading in readings if reading[-1] == min(left)]
