"""What a hidden effect is: how a device gets it, and what the engineer's model has in its place."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
from ibrid_bench.hidden.bases import log_uniform
from ibrid_bench.hidden.parameters import Device

from ibrid.errors import IbridError

Severity = Literal["mild", "clear", "gross"]
SEVERITIES: tuple[Severity, ...] = ("mild", "clear", "gross")
Change = Literal["add", "remove", "replace"]
Verdict = Literal[
    "no-gap", "parameters-only", "named", "located-unnamed", "unexplained", "data-convention"
]
Fields = Mapping[str, Any]

#: In `base`: a parameter that must be there, or must not be there or be zero.
PRESENT, ABSENT = "present", "absent"


@dataclass(frozen=True)
class Strength:
    """A value drawn log-uniformly from the range of a severity, times another parameter of the
    device where one is named.

    either_sign : the sign is drawn as well.
    """

    mild: tuple[float, float]
    clear: tuple[float, float]
    gross: tuple[float, float]
    times: str = ""
    either_sign: bool = False

    def draw(self, severity: Severity, known: Fields, rng: np.random.Generator) -> float:
        """The value, given those that are known."""
        value = log_uniform(rng, *getattr(self, severity))
        if self.either_sign and rng.random() < 0.5:
            value = -value
        return value * known[self.times] if self.times else value


def always(low: float, high: float, *, times: str = "") -> Strength:
    """The same range for every severity."""
    return Strength((low, high), (low, high), (low, high), times=times)


@dataclass(frozen=True, eq=False)
class HiddenEffect:
    """One way in which a device and the engineer's model of it differ.

    id : of the effect; variant : the place or form, one word. change : what repairs the model.
    both, device, model : parameters of `Device` that both, the device alone, the model alone get;
    constants or strengths.
    measurement : parameters of `Measurement`, where the effect is in how the sweep was written.
    base : what the device must be like before, field -> value, PRESENT or ABSENT.
    verdicts : right answers, the best first.
    """

    id: str
    variant: str
    change: Change
    device: Fields = field(default_factory=dict)
    model: Fields = field(default_factory=dict)
    both: Fields = field(default_factory=dict)
    measurement: Fields = field(default_factory=dict)
    base: Fields = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ("named",)

    @property
    def key(self) -> str:
        """ "id:change:variant", the name by which it is asked for; "id" and "id:change" ask for any
        that begins so.
        """
        return f"{self.id}:{self.change}:{self.variant}"

    @property
    def touches(self) -> frozenset[str]:
        """Parameters of the device that it sets in device or model, or in the measurement."""
        return frozenset({*self.both, *self.device, *self.model, *self.measurement})

    def fits(self, device: Device) -> bool:
        """Whether a device can get it."""
        return all(_is(getattr(device, name), wanted) for name, wanted in self.base.items())

    def together_with(self, other: "HiddenEffect") -> bool:
        """Whether both can be hidden in one device: neither sets what the other sets or relies on,
        and they rely on one.
        """
        agree = all(self.base[name] == other.base[name] for name in {*self.base} & {*other.base})
        disturbs = self.touches & {*other.touches, *other.base} or other.touches & {*self.base}
        return agree and not disturbs


def _is(value: object, wanted: object) -> bool:
    if wanted == PRESENT:
        return bool(value)
    return not value if wanted == ABSENT else value == wanted


def drawn(
    settings: Fields, severity: Severity, device: Device, rng: np.random.Generator
) -> dict[str, Any]:
    """Settings with numbers in the place of strengths; a strength may be relative to what the
    device has or just got.
    """
    found: dict[str, Any] = {}
    for name, one in settings.items():
        found[name] = (
            one.draw(severity, {**vars(device), **found}, rng) if isinstance(one, Strength) else one
        )
    return found


def changed(device: Device, settings: Fields) -> Device:
    """The device with other values; IbridError when they do not go together."""
    unknown = set(settings) - {one.name for one in fields(Device)}
    if unknown:
        raise IbridError(
            f"a hidden device has no parameter {', '.join(sorted(unknown))}; see "
            "ibrid_bench.hidden."
        )
    return replace(device, **settings)
