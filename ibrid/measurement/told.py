"""What is said beside the numbers of a foreign file: bases, frequency and operating point, in its comments and its name."""

import re
from collections.abc import Iterable

from ibrid.errors import SweepError
from ibrid.measurement.column_words import unit_of

_NUMBER = r"[-+−]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?"
_UNIT = r"[A-Za-zΩµ%][A-Za-zΩµ./]*|°"
_PAIR = re.compile(rf"([A-Za-z][\w ./-]*?)\s*(?:[\[(]([^\])]*)[\])])?\s*[:=]\s*({_NUMBER})\s*({_UNIT})?")
_WORD = re.compile(r"([A-Za-z][\w ]*?)\s*[:=]\s*([A-Za-z]+)")
_IN_NAME = re.compile(
    r"(?:^|[^a-zA-Z])([pqvPQVuU])[ =_]?(-?|m|neg)(\d+(?:[.,p]\d+)?)\s?(pu|[kM]?W|[kM]?[vV][aA][rR]|k?V)?(?![a-zA-Z0-9])"
)
_BASE_KEYS = {
    "f0_hz": r"f0(hz)?|fn|fnom|f1|(nominal|grid|fundamental|rated|system|base)freq(uency)?(hz)?|netzfrequenz",
    "s_base_va": r"sbase(va)?|sb|sn|snom|srated|s|rated(apparent)?power|basepower|powerbase|nennleistung|rating",
    "v_base_v": r"vbase(v)?|vb|vn|vnom|vrated|un|unom|ratedvoltage|basevoltage|voltagebase|nennspannung|vll|ull",
    "sampling_hz": r"fs|fsamp|samplingfreq(uency)?|samplingrate|samplinghz|sampling",
    "p": r"p|p0|pac|pout|pset|pref|activepower|wirkleistung",
    "q": r"q|q0|qac|qout|qset|qref|reactivepower|blindleistung",
    "v": r"v|v0|u|u0|vpcc|terminalvoltage|voltage|spannung",
}
_WORD_KEYS = {"current": ("out", "in"), "qaxis": ("leads", "lags"), "powernode": ("capacitor", "pcc")}

#: A number, with what its unit measures ("" without a unit) in the plain unit of that.
Told = tuple[float, str]


def told_in_notes(notes: Iterable[str]) -> dict[str, Told | str]:
    """Numbers and words of `key: value` or `key = value` anywhere in comment lines; the first of a key counts."""
    found: dict[str, Told | str] = {}
    for note in notes:
        for name, bracket, value, behind in _PAIR.findall(note):
            key = _key(name)
            if key and key not in found:
                found[key] = _told(value, bracket or behind)
        for name, word in _WORD.findall(note):
            key = re.sub("[^a-z]", "", name.lower())
            if key == "unit" and unit_of(word):
                found.setdefault("unit", word)
            if word.lower() in _WORD_KEYS.get(key, ()):
                found.setdefault({"qaxis": "q_axis", "powernode": "power_node"}.get(key, key), word.lower())
    return found


def told_in_name(stem: str) -> dict[str, Told]:
    """p, q and v as `scan_P0.5_Q-0.1` or `p=50kW,q=10kvar` has them."""
    found: dict[str, Told] = {}
    for letter, sign, value, unit in _IN_NAME.findall(stem):
        number, dimension = _told(value.replace("p", "."), unit)
        found.setdefault(letter.lower().replace("u", "v"), (-number if sign else number, dimension))
    return found


def base_of(text: str, option: str) -> tuple[float, float]:
    """VA and V of a base such as 10kVA,400V or 10e3,400; SweepError otherwise."""
    parts = [re.fullmatch(rf"({_NUMBER})\s*({_UNIT})?", part.strip()) for part in text.split(",")]
    sizes = [_told(part[1], part[2] or "") for part in parts if part]
    wanted = ("power", "voltage")
    if (
        len(sizes) != 2
        or len(parts) != 2
        or any(size[1] not in ("", kind) for size, kind in zip(sizes, wanted, strict=True))
    ):
        raise SweepError(
            f"{option} is apparent power and line-to-line voltage, such as 10kVA,400V; found {text[:40]!r}."
        )
    return sizes[0][0], sizes[1][0]


def _key(name: str) -> str:
    compact = re.sub("[^a-z0-9]", "", name.lower())
    return next((key for key, pattern in _BASE_KEYS.items() if re.fullmatch(pattern, compact)), "")


def _told(value: str, unit: str) -> Told:
    number = float(value.replace("−", "-").replace(",", "."))
    dimension, factor = unit_of(unit) or ("", 1.0)
    return number * factor, dimension
