"""What a sweep file says about its numbers: `# key: value` lines, with a guard against mistyped
keys.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from math import isfinite, radians
from numbers import Complex, Real
from typing import Any, Literal

from ibrid.errors import SweepError, near
from ibrid.measurement.conventions.possible_values import (
    Base,
    require_possible,
    require_possible_admittances,
)
from ibrid.measurement.conventions.rotation import straightened
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, PowerNode, Sweep
from ibrid.ranges import require_in_range

Unit = Literal["pu", "S", "ohm"]

#: Key -> what it may be.
Choices = Mapping[str, tuple[str, ...]]
CHOICES: dict[str, tuple[str, ...]] = {
    "unit": ("pu", "S", "ohm"),
    "current": ("out", "in"),
    "q_axis": ("leads", "lags"),
    "voltage_axis": ("d", "q"),
    "power_node": ("capacitor", "pcc"),
}
POSITIVE = ("f0_hz", "s_base_va", "v_base_v", "sampling_hz")
#: Numbers, one for all operating points or one for each in their order.
LISTS = ("frame_deg",)
HEADER_KEYS = (*CHOICES, *POSITIVE, *LISTS)
#: Those that hold of a sweep in any convention.
OF_SWEEPS = (*POSITIVE, "power_node")
POINT_KEYS = ("op", "p", "q", "v")
"""The operating point, which formats without columns for it carry in the same `key: value` form."""

#: Keys that others write, and ours that say the same, where such a value follows.
_MEANT = dict.fromkeys(("frequency", "freq", "nominalfrequency", "frequencyhz", "fn"), "f0_hz") | {
    "direction": "current"
}
_PLAIN = re.compile(r"[0-9.]+ *(hz)?|in|out", re.IGNORECASE)
_WRITTEN_LINE = re.compile(r"\s*([A-Za-z][A-Za-z0-9_ -]{0,40}?)\s*[:=](.*)", re.DOTALL)
_KEY_LINE = re.compile(r"\s*([A-Za-z][A-Za-z0-9_]*)\s*[:=](.*)", re.DOTALL)


@dataclass(frozen=True)
class Header:
    """How the numbers of a file are meant; unit, current, q_axis, voltage_axis and frame_deg speak
    of the immittance columns alone.

    current : "out" of the inverter (ours) or "in".
    q_axis : "leads" d by 90 degrees (ours) or "lags".
    voltage_axis : "d" (ours) or "q", on which the voltage at rest lies; q with a q axis that lags:
    d and q exchanged.
    frame_deg : by how many degrees the measuring frame leads the axis on which it should have the
    voltage at rest (0); one for
        each operating point in their order where they differ. The side of q is put right first.
    s_base_va, v_base_v : Z_base = v_base_v^2 / s_base_va, no further factor.
    """

    f0_hz: float = 60.0
    unit: Unit = "pu"
    current: Literal["out", "in"] = "out"
    q_axis: Literal["leads", "lags"] = "leads"
    voltage_axis: Literal["d", "q"] = "d"
    power_node: PowerNode = "capacitor"
    s_base_va: float | None = None
    v_base_v: float | None = None
    sampling_hz: float | None = None
    frame_deg: tuple[float, ...] = (0.0,)
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, sweep: Sweep) -> "Header":
        """Of a sweep, whose numbers are in our convention."""
        return cls(**{key: getattr(sweep, key) for key in OF_SWEEPS})

    def sweep(self, points: Sequence[PointSweep], source: str) -> Sweep:
        """The sweep of points that were converted to our convention, but for the angle of their
        frame; SweepError where no device has such a steady state.
        """
        points = self._straightened(points, source)
        base = Base(self.s_base_va, self.v_base_v)
        for point in points:
            require_possible(point.op, base, f"{source}: at {point.op.name}")
        if self.unit != "pu":
            require_possible_admittances(points, self.f0_hz, base, self.unit, source)
        return Sweep(
            tuple(points),
            notes=self.notes,
            source=source,
            **{key: getattr(self, key) for key in OF_SWEEPS},
        )

    def _straightened(self, points: Sequence[PointSweep], source: str) -> list[PointSweep]:
        """The points in the frame of the voltage at rest."""
        if len(self.frame_deg) not in (1, len(points)):
            raise SweepError(
                f"{source}: frame_deg must hold one number, or one for each operating point in "
                "their order; found "
                f"{len(self.frame_deg)} numbers for {len(points)} operating points."
            )
        angles = self.frame_deg * (len(points) if len(self.frame_deg) == 1 else 1)
        return [
            straightened(point, radians(angle)) for point, angle in zip(points, angles, strict=True)
        ]


def read_keys(
    comments: Iterable[tuple[int, str]],
    where: str,
    known: Iterable[str] = HEADER_KEYS,
    choices: Choices = CHOICES,
) -> tuple[dict[str, str], tuple[str, ...]]:
    """The keys and the notes of comment lines.

    comments : (line number, text without its comment mark).
    where : the file's name, for errors.
    choices : what keys with words may say.

    Raises SweepError, with the line, for a key that resembles a known one or means the same without
    being it, a key given twice and a value out of range.
    """
    names = tuple(known)
    keys: dict[str, str] = {}
    notes: list[str] = []
    for line, text in comments:
        match = _KEY_LINE.fullmatch(text)
        if match is None:
            if (written := _WRITTEN_LINE.fullmatch(text)) and (
                key := _underscored(written[1])
            ) in names:
                raise SweepError(
                    f"{where} line {line}: {written[1].strip()} is not a key, it is written {key}; "
                    "correct it."
                )
            if written := _key_without_colon(text, names, choices):
                raise SweepError(
                    f"{where} line {line}: a colon stands behind a key; write {written}."
                )
            if text.strip():
                notes.append(text.strip())
            continue
        key, value = match[1], match[2].strip()
        if key in names:
            if key in keys and keys[key] != value:
                raise SweepError(
                    f"{where} line {line}: {key} must be given once; found {keys[key]} and {value}."
                )
            values_of({key: value}, f"{where} line {line}", choices)
            keys[key] = value
            continue
        if likely := meant_by(key, value, names):
            raise SweepError(
                f"{where} line {line}: {key} is not a key, {likely}; correct it, or drop the colon "
                "if it is a note."
            )
        notes.append(text.strip())
    return keys, tuple(one.removeprefix("note - ") for one in notes)  # as the writers mark them


def _key_without_colon(text: str, names: tuple[str, ...], choices: Choices) -> str:
    """How a key with a value that it may have is written, where the colon lacks; "" for a note that
    begins with such a word.
    """
    key, _, value = text.strip().partition(" ")
    try:
        meant = key in names and values_of({key: value.strip()}, "", choices)
    except SweepError:
        return ""
    return f"{key}: {value.strip()}" if meant else ""


def _underscored(key: str) -> str:
    """A key that is written with blanks or hyphens, as options are."""
    return re.sub(r"[\s-]+", "_", key.strip().lower())


def meant_by(key: str, value: str, names: tuple[str, ...]) -> str:
    """Which known key is meant by one that resembles it, in words; "" for none."""
    meant = _MEANT.get(key.lower().replace("_", "")) if _PLAIN.fullmatch(value) else None
    if meant in names:
        return near(meant, [meant])
    return near(key, names) if _mistyped(key, names) else ""


def header_of(keys: Mapping[str, object], where: str, notes: tuple[str, ...] = ()) -> Header:
    """The header that these keys make; other keys are left alone.

    SweepError when a value is out of range.
    """
    return Header(**values_of(keys, where), notes=notes)


def values_of(keys: Mapping[str, object], where: str, choices: Choices = CHOICES) -> dict[str, Any]:
    """Words and numbers of the keys that are given; other keys are left alone.

    SweepError when a value is out of range.
    """
    values: dict[str, Any] = {}
    for key in (*choices, *POSITIVE):
        value = keys.get(key)
        if value is None:
            continue
        if key in choices:
            if value not in choices[key]:
                raise SweepError(
                    f"{where}: {key} must be {' or '.join(choices[key])}; found {value}."
                )
            values[key] = value
        else:
            number = number_of(value, f"{where}: {key}")
            if number <= 0:
                raise SweepError(f"{where}: {key} must be positive; found {value}.")
            require_in_range(key, number, f"{where}: {key}")
            values[key] = number
    for key in LISTS:
        if keys.get(key) is not None:
            values[key] = tuple(number_of(one, f"{where}: {key}") for one in _listed(keys[key]))
            for number in values[key]:
                require_in_range(key, number, f"{where}: {key}")
    return values


def point_of(keys: Mapping[str, object], where: str, default_name: str) -> OperatingPoint:
    """The operating point that these keys describe, for formats without columns op, p, q, v.

    Raises SweepError when p or q is missing: without them the equilibrium is unknown.
    """
    missing = [key for key in ("p", "q") if keys.get(key) is None]
    if missing:
        raise SweepError(
            f"{where} must come with the steady state p and q (per unit, delivered); "
            f"{' and '.join(missing)} "
            f"missing: add a line '{missing[0]}: 0.8' to {where}.meta, or give {missing[0]}=0.8 "
            "when reading it."
        )
    numbers = {
        key: number_of(keys[key], f"{where}: {key}")
        for key in ("p", "q", "v")
        if keys.get(key) is not None
    }
    return OperatingPoint(str(keys.get("op") or default_name), **numbers)


def number_of(value: Any, what: str) -> float:
    """A finite number; SweepError, beginning with `what`, otherwise, also for a complex one and for
    digits of other scripts.
    """
    try:
        number = (
            float("nan") if _is_complex(value) else float(value)
        )  # NumPy would drop the imaginary part
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not isfinite(number) or (
        isinstance(value, str) and ("_" in value or not value.strip().isascii())
    ):
        raise SweepError(f"{what} must be a finite number; found {str(value)[:60]!r}.")
    return number


def _is_complex(value: object) -> bool:
    return isinstance(value, Complex) and not isinstance(value, Real)


def known_keys(given: Mapping[str, object]) -> dict[str, object]:
    """Keyword arguments that name header or operating point keys; SweepError, with the near names,
    for others.
    """
    for key in given:
        if key not in HEADER_KEYS + POINT_KEYS:
            raise SweepError(
                f"{key} is not something to say about a sweep; "
                f"{near(key, HEADER_KEYS + POINT_KEYS)}"
            )
    return {key: value for key, value in given.items() if value is not None}


def header_values(header: Header) -> dict[str, object]:
    """The header's keys that differ from their defaults."""
    return {
        field.name: getattr(header, field.name)
        for field in fields(header)
        if field.name != "notes" and getattr(header, field.name) != field.default
    }


def _listed(value: object) -> list[object]:
    """The parts of a list, of text with commas, or of a number alone."""
    if isinstance(value, str):
        return [part.strip() for part in value.split(",")]
    return list(value) if isinstance(value, Iterable) else [value]


def _mistyped(key: str, names: tuple[str, ...]) -> bool:
    """Whether a key resembles a known one: nearly the same letters, its beginning (f0) or more of
    it (current_dir).
    """
    plain = key.lower().replace("_", "")
    known = [name.replace("_", "") for name in names]
    close = get_close_matches(plain, known, n=1, cutoff=0.75)
    part = any(
        name.startswith(f"{key.lower()}_") or key.lower().startswith(f"{name}_") for name in names
    )
    return part or bool(close)
