"""COMTRADE records (.cfg with .dat, or .cff): phases of a recorder, in primary volts and
amperes.
"""

import re
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from ibrid.errors import SweepError
from ibrid.measurement.formats.bundle import beside
from ibrid.measurement.formats.files import read_bytes
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.importing.binary.foreign_binary import comtrade_arrays
from ibrid.measurement.importing.column_words import unit_of
from ibrid.measurement.importing.doubts.transformer_ratio import Ratios
from ibrid.measurement.recordings.channels import (
    BETWEEN,
    PHASES,
    Channel,
    ToldChannels,
    channels_told,
    chosen,
    require_one_role_each,
)
from ibrid.measurement.recordings.event_samples import Samples

SUFFIXES = (".cfg", ".dat", ".cff")
_PARTS = re.compile(
    rb"(?:\A(?:\xef\xbb\xbf)?|(?<=[\r\n]))--- *file type: *(\w++)[^\r\n]*---[ \t]*(?:\r?\n|\r)",
    re.I,
)
_AMPERE = {"a": 1.0, "ka": 1e3, "ma": 1e-3}

#: Times of a record, s: the latest and the least span; largest factor, offset and ratio of a
#: channel; and the part of a record that a channel may be sampled later.
LONGEST, SHORTEST, LARGEST, SKEWED = 1e9, 1e-6, 1e9, 0.1
#: Steps of time above so many usual ones are a gap.
JUMP = 5.0


def read_comtrade(
    path: Path, channels: ToldChannels = None, ratios: Ratios | None = None
) -> tuple[Samples, float | None]:
    """The record of a COMTRADE file, and its nominal frequency if it says one.

    channels : `va=1,vb=2,vc=3,ia=4,ib=5,ic=6`, numbers or names, where names and units do not show
    them; vab, vbc, vca for
        voltages between the phases.
    ratios : of secondary channels for which the configuration has none.

    Values are primary ones: those of channels that are secondary are multiplied by the ratio of the
    transformer. A channel that was sampled later than the record's time says (skew) is brought to
    it by a spline.

    Raises SweepError: a file is missing, damaged or has no such channels; samples are missing.
    """
    where = str(path)
    arrays = guarded(comtrade_arrays, _content(path), f"{where} must be a COMTRADE record")
    told = channels_told(channels)
    known = [
        Channel(*map(str, row))
        for row in zip(arrays["name"], arrays["unit"], arrays["phase"], strict=True)
    ]
    place = chosen(known, told, where)
    require_one_role_each(place, [channel.name for channel in known], where)
    between = set(BETWEEN) <= set(place)
    roles = (*(BETWEEN if between else PHASES[:3]), *PHASES[3:])
    time = arrays["time"]
    _require_sizes(arrays, known, [place[role] for role in roles], where)
    _require_ratios(arrays["ratio"][[place[role] for role in roles]], ratios, where)
    if (np.diff(time) <= 0).any():
        raise SweepError(
            f"{where}: the times of the samples must increase; sample "
            f"{int(np.argmax(np.diff(time) <= 0)) + 2} goes back, do the "
            "data belong to this configuration?"
        )
    values, remarks = [], _jumps(arrays["stamp"], time)
    if arrays["lost"]:
        remarks.append(
            f"the data end early, {arrays['lost']} samples fewer than the configuration announces"
        )
    if arrays["beyond"]:
        remarks.append(
            f"{arrays['beyond']} samples stand behind those that the configuration announces and "
            "continue them: read"
        )
    if arrays["left_out"]:
        remarks.append(
            f"{arrays['left_out']} rows stand behind the samples that the configuration announces "
            "and do not continue them: left "
            "out; another record, which needs a file and a configuration of its own?"
        )
    for role in roles:
        k = place[role]
        value = arrays["value"][k]
        missing = np.flatnonzero(np.isnan(value))
        if len(missing):
            raise SweepError(
                f"{where}: channel {known[k].name} must have all its samples; {len(missing)} are "
                "missing, the first at "
                f"{time[missing[0]]:g} s, cut the record there."
            )
        if _clipped(value, float(arrays["low"][k]), float(arrays["high"][k])):
            remarks.append(f"channel {known[k].name} reaches the end of its range: it is clipped")
        if arrays["skew"][k]:
            value = CubicSpline(time + arrays["skew"][k], value)(time)
        ratio = float(arrays["ratio"][k])
        if np.isnan(ratio) and ratios is not None:
            ratio = ratios.of(role)
            remarks.append(f"channel {known[k].name} is secondary: taken times {ratio:g}, as said")
        elif np.isnan(ratio):
            remarks.append(
                f"channel {known[k].name} is secondary without a ratio: taken as it stands"
            )
        elif ratio != 1:
            remarks.append(f"channel {known[k].name} taken times {ratio:g}, to its primary value")
        values.append(value * np.nan_to_num(ratio, nan=1.0) * _size(known[k].unit, role, where))
    values = np.array(values)
    v = (values[:3] - np.roll(values[:3], 1, axis=0)) / 3 if between else values[:3]
    stem = (
        "".join(letter if letter.isprintable() else "_" for letter in path.stem).strip("# ")
        or "record"
    )
    return Samples(stem, time, v, values[3:], None, tuple(remarks)), float(
        arrays["frequency"]
    ) or None


def _require_ratios(stated: np.ndarray, said: Ratios | None, where: str) -> None:
    if said is not None and np.isfinite(stated).all():
        raise SweepError(
            f"{where}: the configuration says which channels are primary and the ratio of the "
            "others, which are multiplied by it; leave out --ratio."
        )


def _require_sizes(
    arrays: dict[str, np.ndarray], known: list[Channel], used: list[int], where: str
) -> None:
    """SweepError where a number of the configuration is none that a recorder has."""
    time = arrays["time"]
    if not (np.isfinite(time).all() and np.abs(time).max() < LONGEST and np.ptp(time) > SHORTEST):
        raise SweepError(
            f"{where}: the times of the samples must lie within {LONGEST:g} s and span "
            f"{SHORTEST:g} s; found "
            f"{time[0]:g} to {time[-1]:g} s, see the sampling rate and the multiplier of time."
        )
    for k in used:
        numbers = {
            "factor a": arrays["factor"][k, 0],
            "offset b": arrays["factor"][k, 1],
            "ratio": arrays["ratio"][k],
        }
        for name, number in numbers.items():
            if np.isinf(number) or abs(number) > LARGEST or (np.isnan(number) and name != "ratio"):
                raise SweepError(
                    f"{where}: the {name} of channel {known[k].name} must be at most {LARGEST:g}; "
                    f"found {number:g}."
                )
        if abs(arrays["skew"][k]) > SKEWED * np.ptp(time):
            raise SweepError(
                f"{where}: the skew of channel {known[k].name} must be short beside the record, in "
                "microseconds; found "
                f"{1e6 * arrays['skew'][k]:g} in a record of {np.ptp(time):g} s."
            )


def _content(path: Path) -> bytes:
    """Length of the configuration, it, and the samples."""
    if path.suffix.lower() == ".cff":
        pieces = _PARTS.split(read_bytes(path))[1:]
        parts = {kind.upper(): piece for kind, piece in zip(pieces[::2], pieces[1::2], strict=True)}
        if not {b"CFG", b"DAT"} <= set(parts):
            raise SweepError(
                f"{path} must hold a part '--- file type: CFG ---' and one DAT; found neither or "
                "one."
            )
        configuration, data = parts[b"CFG"], parts[b"DAT"]
    else:
        configuration, data = (read_bytes(_beside(path, suffix)) for suffix in (".cfg", ".dat"))
    return len(configuration).to_bytes(8, "big") + configuration + data


def _beside(path: Path, suffix: str) -> Path:
    """The file of that suffix, in small or capital letters, in its folder or archive."""
    if path.suffix.lower() == suffix:
        return path
    wanted = path.stem.lower() + suffix
    for one in sorted(beside(path), key=lambda one: one.stem != path.stem):
        if one.name.lower() == wanted:
            return one
    raise SweepError(
        f"{path} must lie beside the {suffix[1:]} file of the record; found none, copy "
        f"{path.with_suffix(suffix).name} there."
    )


def _jumps(stamp: np.ndarray, time: np.ndarray) -> list[str]:
    """A remark where the times beside the samples jump and those by the rate do not."""
    steps = np.diff(stamp) if np.isfinite(stamp).all() else np.zeros(0)
    if not len(steps) or not np.median(steps) > 0:
        return []
    k = int(np.argmax(steps))
    jump, usual = steps[k] / np.median(steps), np.median(np.diff(time))
    if len(stamp) != len(time) or jump <= JUMP or time[k + 1] - time[k] > JUMP * usual:
        return []
    return [
        f"a gap: the times beside the samples jump by {jump:.0f} samples at {time[k]:.4g} s, the "
        "rate that the record states "
        "runs on; cut the record there"
    ]


def _clipped(value: np.ndarray, low: float, high: float) -> bool:
    """Whether two samples in a row stand at an end of the range; a range without width says
    nothing.
    """
    margin = 1e-6 * abs(high - low)
    ends = (value >= max(low, high) - margin) | (value <= min(low, high) + margin)
    return margin > 0 and bool((ends[1:] & ends[:-1]).any())


def _size(unit: str, role: str, where: str) -> float:
    """Size of a channel's unit in V or A; a unit that is not said is plain."""
    unit = unit.strip()
    if role[0] == "i":
        size = _AMPERE.get(unit.lower(), 1.0 if not unit else None)
    else:
        said = unit_of(unit) if unit else ("voltage", 1.0)
        size = said[1] if said and said[0] == "voltage" else None
    if size is None:
        raise SweepError(
            f"{where}: the channel of {role} must be in {'A' if role[0] == 'i' else 'V'}; found "
            f"{unit[:20]!r}."
        )
    return size
