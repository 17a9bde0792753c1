"""Words that the page and the text of a gap share: headlines, effects, intervals, evidence."""

from collections.abc import Iterator, Mapping
from typing import Any

from ibrid.gap.results.gap import Gap, NamedEffect, ParameterChange
from ibrid.gap.results.verdict import FAR
from ibrid.measurement.conventions.labels import ROTATION
from ibrid.parts.catalogue import CATALOGUE
from ibrid.parts.editing.practice import Effect
from ibrid.parts.plant.nonlinear import NONLINEAR
from ibrid.report.look.numbers import interval, more_readable, number, p_value

#: Said where nobody knows a number.
UNKNOWN = "not known"
_CHANGES = {
    "add": "missing in the model",
    "remove": "not in the device",
    "replace": "different in the device",
}
_HEADLINES = {
    "no-gap": "No gap",
    "parameters-only": "Wrong parameters, nothing missing",
    "located-unnamed": "Located, but not named",
    "unexplained": "A gap that nothing explains",
    "data-convention": "The data are written otherwise than the model means",
}
#: Verdicts that exclude what was not found, once everything was tried.
EXCLUDING = ("parameters-only", "located-unnamed", "unexplained")
FORM_ALONE = "The device has its delays in another form, nothing else is missing"


def headline(gap: Gap) -> str:
    """A few words for the top of a page."""
    if gap.verdict == "named" and gap.effects:
        groups: dict[str, list[str]] = {}
        for one in gap.effects:
            groups.setdefault(_CHANGES.get(one.change, one.change), []).append(one.id)
        words = "; ".join(f"{what}: {', '.join(ids)}" for what, ids in groups.items())
        return f"{words[0].upper()}{words[1:]}"
    if not gap.complete and gap.verdict in EXCLUDING:
        return "Unfinished: not everything was tried"
    return FORM_ALONE if of_forms_alone(gap) else _HEADLINES.get(gap.verdict, gap.verdict)


def of_forms_alone(gap: Gap) -> bool:
    """True when nothing but the form of the device's delays is told: the data are as they should
    be.
    """
    known = [declared(one.id) for one in gap.effects]
    return bool(known) and all(one is not None and one.form for one in known)


def declared(name: str) -> Effect | None:
    """The catalogue's declaration of an id; None for an effect of the user's own."""
    return next((one for one in (*CATALOGUE, *NONLINEAR) if one.id == name), None)


def change_words(effect: NamedEffect) -> str:
    """What the edit says of the device, or of the measurement."""
    known = declared(effect.id)
    if effect.id == ROTATION or (known is not None and known.measurement):
        return f"in the measurement, not in the device: {effect.where}"
    return f"{_CHANGES.get(effect.change, effect.change)}: {effect.where}"


def parameter_words(gap: Gap, effect: NamedEffect) -> Iterator[tuple[str, str, str, str]]:
    """(name, value with unit, the same in the unit one thinks in, 95 % interval) of each parameter
    of an effect.
    """
    for name, (value, low, high) in effect.parameters.items():
        box = gap.repaired.boxes.get(name, {})
        unit = "rad" if name.startswith("angle") else str(box.get("unit", "")).removesuffix("1")
        bounds = (box["low"], box["high"]) if "low" in box and "high" in box else None
        ends = None if low is None or high is None else (low, high)
        words = UNKNOWN if ends is None else interval(value, ends, bounds)
        yield name, f"{number(value)} {unit}".strip(), more_readable(value, unit), words


def moved_interval(parameter: ParameterChange) -> str:
    """The 95 % interval of a parameter."""
    return (
        "not visible"
        if parameter.low is None or parameter.high is None
        else interval(parameter.refitted, (parameter.low, parameter.high), None)
    )


def far(gap: Gap) -> list[ParameterChange]:
    """Parameters that moved beyond three standard deviations of their tolerance."""
    return [one for one in gap.moved if abs(one.sigmas) > FAR]


_EVIDENCE = {
    "gain": ("fall of the cost (chi2 and prior)", number),
    "threshold": ("fall that chance alone would reach once in a thousand searches", number),
    "tests": ("edits and conventions that were tried", number),
    "p_before": ("p value of the fit, before", p_value),
    "p_after": ("p value of the fit, after", p_value),
    "runner_up": ("best edit by another effect", str),
    "runner_up_bic": ("how much worse it is (BIC)", number),
    "noise_scale": ("factor on the assumed noise", number),
}
#: Data that a refit did not see.
HELD_OUT = {
    "frequencies": "every fourth frequency, not fitted",
    "points": "each operating point, not fitted",
    "records": "each record, not fitted",
}


def evidence_words(evidence: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """(what, value) of what an effect rests on; keys without words of their own stand as they
    are.
    """
    for key, value in evidence.items():
        if value is None:
            continue
        if key == "held_out":
            yield from _held_out_words(value)
            continue
        words, form = _EVIDENCE.get(key, (key.replace("_", " "), _plain))
        yield words, form(value)


def _held_out_words(value: Mapping[str, Mapping[str, float | None]]) -> Iterator[tuple[str, str]]:
    before, after = value.get("before", {}), value.get("after", {})
    for key, words in HELD_OUT.items():
        if before.get(key) is not None or after.get(key) is not None:
            yield (
                f"misfit over noise at {words}",
                f"{number(before.get(key), 3)} → {number(after.get(key), 3)}",
            )


def _plain(value: Any) -> str:
    return (
        number(value)
        if isinstance(value, int | float) and not isinstance(value, bool)
        else str(value)
    )
