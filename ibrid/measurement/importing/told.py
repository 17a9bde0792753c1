"""What is said beside the numbers of a foreign file: bases, frequency and operating point, in its
comments and its name.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import pi

from ibrid.errors import SweepError
from ibrid.measurement.importing.column_words import (
    BESIDE,
    ROLE_NAMES,
    letters_of,
    unit_of,
    without_unit,
)
from ibrid.measurement.sweeps.quantities import engineering
from ibrid.ranges import require_in_range

_NUMBER = r"[-+−]?(?:\d+(?:[.,]\d+)?|\.\d+)(?:[eE][-+]?\d+)?"
_UNIT = r"[A-Za-zΩµ%][A-Za-zΩµ./]*|°"
# possessive (*+): blanks that two places may take would cost the square of their number
_PAIR = re.compile(
    rf"([^\W\d_][\w ./-]{{0,80}}?)\s*+(?:[\[(]([^\])]{{0,40}})[\])]\s*+)?[:=]\s*+({_NUMBER})"
    rf"\s*((?:{_UNIT})(?![\w.%])(?!\s*[:=]))?"
)
#: What stands behind a number and belongs to it: up to the next mark, name of a number or end.
_BEHIND = re.compile(r"(?:(?![,;|\n]|[^\W\d_][\w ./-]{0,20}[:=]).){0,40}")
#: Words beside a base or a power with which it is another one than that of three phases, line to
#: line and rms, or of power that is delivered; and words that say just that.
_OF_BASE = re.compile(r"\b(l-?n|neutral|phase|peak|pk|pp|amplitude)\b", re.IGNORECASE)
_AS_USUAL = re.compile(
    r"\b(three|3)[ -]?phase\b|\bphase[ -](to[ -])?phase\b|\bline[ -](to[ -])?line\b", re.IGNORECASE
)
#: A second number behind a slash: 230/400 V, 1/2.
_SECOND = re.compile(r"\s*/\s*\d")
_OF_POWER = re.compile(
    r"\b(load|consum\w*|absor\w*|import\w*|drawn|charging|ind|inductive|cap|capacitive|lag|lagging|"
    r"lead|leading|under-?excited|over-?excited|per phase)\b",
    re.IGNORECASE,
)
_DOUBTS = {"s_base_va": _OF_BASE, "v_base_v": _OF_BASE, "p": _OF_POWER, "q": _OF_POWER}
#: The same behind P, Q or V in the name of a file.
_DOUBTED_NAME = re.compile(r"[ _-]?(load|abs|ind|cap|lag|lead)(?![a-zA-Z])", re.IGNORECASE)
#: The quarter of a year, which is no reactive power.
_QUARTER = re.compile(r"(?<!\d)(?:19|20)\d\d[-_ ]?Q[1-4](?![\d.,p])")
_WORD = re.compile(r"([A-Za-z][\w ]{0,80}?)\s*+[:=]\s*+([A-Za-z]+)")
_IN_NAME = re.compile(
    r"(?:^|[^a-zA-Z])([pqvPQVuU])[ =_]?\+?(-?|m|neg)(\d+(?:[.,p]\d+)?)\s?(pu|[kM]?W|[kM]?[vV][aA][rR]|k?V)?(?![a-zA-Z0-9])"
)
_BASE_KEYS = BESIDE | {role: f"{role}set|{ROLE_NAMES[role]}" for role in "pqv"}
_OMEGA_0 = re.compile(r"(w|omega|ω)(0|n|nom|b|base)")
#: The nominal frequency in words before its number, without a mark between.
_F0_IN_WORDS = re.compile(
    r"((?:nominal|rated|nenn|bemessungs)[ _-]?(?:frequency|frequenz)|"
    r"fr[eé]quence nominale|frecuencia nominal|frequenza nominale)\s+(?:is |=|est |ist )?"
    r"(?=\d+(?:[.,]\d+)?\s*Hz\b)",
    re.IGNORECASE,
)
#: The way in which the current counts, in a sentence: towards the device, or out of the grid; and
#: words with which it may say something else.
_CURRENT_IN_WORDS = re.compile(
    r"\b(?:currents?|str[oö]me?|courants?|corrientes?)\b[^.;\n]{0,40}?"
    r"\b(?P<way>into|towards?|to|in(?= (?:das|den|die) )|ins|zum|zur|vers|dans|hacia|out of|from|leaving|aus|vom|depuis|"
    r"sortant de|desde)\s+(?:the |das |den |die |dem |der |le |la |el |l['’])?"
    r"(?:(?P<device>device|inverter|converter|unit|plant|ger[aä]t|(?:wechsel|um)richter|anlage|"
    r"onduleur|convertisseur|appareil|equipo|inversor|convertidor)|"
    r"(?P<grid>grid|network|netz|r[eé]seau|red))\b",
    re.IGNORECASE,
)
_OUT_OF = re.compile("out of|from|leaving|aus|vom|depuis|sortant de|desde", re.IGNORECASE)
_COUNTS = re.compile(
    r"positi|\bcount|z[aä]hl|\bcompt|\bcuenta|convention|\bmeasured\b|direction", re.IGNORECASE
)
_NOT = re.compile(r"\b(?:not?|nicht|kein\w*|pas|negativ\w*|n[eé]gati\w*)\b", re.IGNORECASE)
#: The nominal frequency with its unit, which says nothing of other frequencies.
F0_TOLD = re.compile(
    r"(?<![\w])(?:f0|[fw]_?(?:n|nom|b)|w_?0|(?:omega|ω)_?(?:0|n|nom|b|base)|(?:nominal|grid|rated|base)[ _]?(?:angular[ _]?)?"
    rf"frequency)\s*+(?:[\[(][^\])]*[\])]\s*+)?[:=]\s*+{_NUMBER}\s*(?:rad\s?/\s?s(?:ec)?)?",
    re.I,
)
_WORD_KEYS = {
    "current": ("out", "in"),
    "currentdirection": ("out", "in"),
    "qaxis": ("leads", "lags"),
    "voltageaxis": ("d", "q"),
    "powernode": ("capacitor", "pcc"),
}
_KEYS = {
    "currentdirection": "current",
    "qaxis": "q_axis",
    "voltageaxis": "voltage_axis",
    "powernode": "power_node",
}

#: A power in VA in words of a file, perhaps with a voltage behind it and a word before both that
#: calls them a base; words of a line with which they are those of another device.
_RATING = re.compile(
    rf"(\b[Bb]as(?:e|is)\b[^\d\n]{{0,12}})?(?<![\w.,])({_NUMBER})\s*([kMG]?VA)\b"
    rf"(?:\s*+(?:[,:;/@]|at|bei|à|a)?\s*+({_NUMBER})\s*(k?V)\b)?"
)
_OF_ANOTHER = re.compile(
    r"tra?n?s?fo|per phase|grid|netz|load|last\b|short|kurz|cable|source|r[eé]seau", re.I
)

#: A number, with what its unit measures ("" without a unit) in the plain unit of that, its name and
#: its unit.
Told = tuple[float, str, str, str]


def numbers_beside(stem: str, notes: Iterable[str]) -> dict[str, tuple[float, str]]:
    """Name -> value and unit of `name = value unit` anywhere in comment lines, the first of a name;
    P, Q and V as the name of a file such as `scan_P0.5_Q-0.1` or `p=50kW,q=10kvar` has them. V
    without P, Q and a unit is a version, as in `scan_v2`.
    """
    numbers: dict[str, tuple[float, str]] = {}
    for pair in _pairs(notes):
        numbers.setdefault(pair.name, (pair.value, pair.unit))
    named = _named(stem)
    letters = {letter.upper() for letter, *_ in named}
    for letter, sign, value, unit in named:
        if (
            letter in "vV"
            and not unit
            and not ({"P", "Q"} <= letters and re.search("[.,p]", value))
        ):
            continue
        size = _number(value.replace("p", "."))
        numbers.setdefault(letter.upper().replace("U", "V"), (-size if sign else size, unit))
    return numbers


def doubts_beside(stem: str, notes: Iterable[str]) -> tuple[str, ...]:
    """What of bases and powers is not taken, since words beside it may make another of it; and what
    is told twice with different numbers, of which the first is taken.
    """
    doubts = []
    taken: dict[str, tuple[str, float]] = {}
    for pair in _pairs(notes):
        shown = f"{pair.name} {pair.value:g} {pair.unit}".strip()
        if pair.doubt:
            doubts.append(f"{shown} is not taken, as {pair.doubt!r} may make another of it")
        elif pair.key:
            size = pair.value * (unit_of(pair.unit) or ("", 1.0))[1]
            first, before = taken.setdefault(pair.key, (shown, size))
            if before != size:
                doubts.append(f"{first} is taken, while {shown} stands there too")
    if doubted := {letter for letter, *_, is_doubted in _named_parts(stem) if is_doubted}:
        doubts.append(f"{', '.join(sorted(doubted))} of the name {stem} are not taken")
    return tuple(dict.fromkeys(doubts))


@dataclass(frozen=True)
class _Pair:
    """`name = value unit` in a comment line.

    key : what the name means, "" for nothing known. doubt : the words around, where one of them may
    make another number of it, else "".
    """

    name: str
    value: float
    unit: str
    key: str
    doubt: str


def _pairs(notes: Iterable[str]) -> Iterator[_Pair]:
    for note in notes:
        for match in _PAIR.finditer(note):
            name, bracket, value, behind = match.groups(default="")
            rest = _BEHIND.match(note, match.end())
            after = rest[0] if rest else ""
            key = _key_of(name)
            bare, unit_in_name = without_unit(name.strip())
            if not key and not (bracket or behind) and (key := _key_of(bare)):
                name, behind = bare, unit_in_name  # P_pu, Q_kvar
            words = " ".join(filter(None, (name, bracket, behind, after)))
            is_one_of_two = not behind and _SECOND.match(after) is not None
            is_doubted = key in _DOUBTS and (
                is_one_of_two or _DOUBTS[key].search(_AS_USUAL.sub("", words)) is not None
            )
            doubt = words.strip() if is_doubted else ""
            yield _Pair(name.strip(), _number(value), bracket or behind, key, doubt)


def _key_of(name: str) -> str:
    """The key that the name of a number means; "" for none."""
    letters = letters_of(name)
    return next((key for key, pattern in _BASE_KEYS.items() if re.fullmatch(pattern, letters)), "")


def _named_parts(stem: str) -> list[tuple[str, str, str, str, bool]]:
    """Letter, sign, value, unit of P, Q and V in the name of a file, and whether a word behind may
    turn it.
    """
    plain = _QUARTER.sub("", stem)
    parts = []
    for found in _IN_NAME.finditer(plain):
        letter, sign, value, unit = found.groups(default="")
        is_doubted = _DOUBTED_NAME.match(plain, found.end()) is not None
        parts.append((letter, sign, value, unit, is_doubted))
    return parts


def _named(stem: str) -> list[tuple[str, str, str, str]]:
    return [found[:4] for found in _named_parts(stem) if not found[4]]


def rating_beside(notes: Iterable[str]) -> dict[str, Told]:
    """Power and voltage of the one pair `2.75 MVA / 690 V`, or of the one power, that notes tell:
    `s_base_va` and `v_base_v` where a word calls the pair a base, else `rating_va` and `rating_v`.
    """
    lines = (note for note in notes if not _OF_ANOTHER.search(note))
    found = {rating.groups() for note in lines for rating in _RATING.finditer(note)}
    if len(found) != 1:
        return {}
    called, power, unit, voltage, volts = found.pop()
    keys = ("s_base_va", "v_base_v") if called and voltage else ("rating_va", "rating_v")
    sizes = ((power, unit), (voltage, volts))
    told = (_told(_number(size), unit, "base") for size, unit in sizes if size)
    return dict(zip(keys, told, strict=False))


def base_in_words(power: float | None, voltage: float | None) -> str:
    """`2.75MVA,690V`, as `--base` takes it; one alone where the other is not known."""
    sizes = ((power, "VA"), (voltage, "V"))
    shown = [engineering(value, unit) for value, unit in sizes if value]
    return ",".join(shown).replace(" ", "")


def told_beside(stem: str, notes: Iterable[str]) -> dict[str, Told | str]:
    """The numbers of known names, and words of `key: value` or `key = value`; the first of a key
    counts, and none that words beside it may turn.
    """
    entries: dict[str, Told | str] = {}
    notes = tuple(_F0_IN_WORDS.sub(r"\1: ", note) for note in notes)
    doubted = {pair.name for pair in _pairs(notes) if pair.doubt}
    for name, (value, unit) in numbers_beside(stem, notes).items():
        if name in doubted:
            continue
        if key := _key_of(name):
            told = _told(value, unit, name)
            entries.setdefault(key, _in_hertz(told) if key == "f0_hz" else told)
        elif _OMEGA_0.fullmatch(letters_of(name)):
            entries.setdefault("f0_hz", _in_hertz(_told(value, unit or "rad/s", name)))
    for note in notes:
        for name, word in _WORD.findall(note):
            key = re.sub("[^a-z]", "", name.lower())
            if key == "unit" and (unit_of(word) or ("",))[0] in (
                "admittance",
                "impedance",
                "per unit",
            ):
                entries.setdefault("unit", word)
            if word.lower() in _WORD_KEYS.get(key, ()):
                entries.setdefault(_KEYS.get(key, key), word.lower())
    if way := current_in_words(notes):
        entries.setdefault("current", way[0])
    called = {key: told for key, told in rating_beside(notes).items() if key in _BASE_KEYS}
    return called | entries


def current_in_words(notes: Iterable[str]) -> tuple[str, str] | None:
    """Which way the current counts, `in` or `out`, and the sentence that says it; None where none
    does, or two say different ways.
    """
    sentences: dict[str, str] = {}
    for note in notes:
        said = _CURRENT_IN_WORDS.search(note)
        if said and _COUNTS.search(note) and not _NOT.search(note):
            away = _OUT_OF.fullmatch(said["way"]) is not None
            sentences[("in", "out")[away == bool(said["device"])]] = note.strip("#%! ")
    return sentences.popitem() if len(sentences) == 1 else None


def point_said(text: str) -> tuple[str, dict[str, tuple[float, str]]]:
    """Name, and p, q, v as (number, dimension), of `full:p=0.8,q=0.1`, `p=80MW,q=0` or a name
    alone; SweepError otherwise.
    """
    wanted = (
        f"--op is written NAME, or NAME:p=0.8,q=0.1,v=1 with numbers or 80kW; found {text[:40]!r}"
    )
    said = re.fullmatch(r"(?:(.*?)\s*:)?\s*((?:[pqvPQV]\s*=[^,=]*(?:,\s*|$))+)", text.strip())
    if said is None:
        name = text.strip()
        if not name.strip(":") or name.endswith(":") or "=" in name:
            raise SweepError(f"{wanted}.")
        return name, {}
    powers: dict[str, tuple[float, str]] = {}
    for item in filter(None, said[2].split(",")):
        role, _, value = (part.strip() for part in item.partition("="))
        role = role.lower()
        size = re.fullmatch(rf"({_NUMBER})\s*({_UNIT})?", value)
        told = _told(_number(size[1]), size[2] or "") if size else (0.0, "none", "", "")
        if told[1] not in ("", "per unit", *(["power"] if role != "v" else [])):
            raise SweepError(f"{wanted}.")
        if role in powers:
            raise SweepError(f"{wanted}, which says {role} twice.")
        powers[role] = told[0], told[1] or "per unit"
    return (said[1] or "").strip(), powers


def base_of(said: object, option: str) -> tuple[float, float]:
    """VA and V of a base such as 10kVA,400V or 10e3,400, or the two numbers; SweepError
    otherwise.
    """
    text = ",".join(map(str, said)) if isinstance(said, tuple | list) else str(said)
    parts = [re.fullmatch(rf"({_NUMBER})\s*({_UNIT})?", part.strip()) for part in text.split(",")]
    sizes = [_told(_number(part[1]), part[2] or "") for part in parts if part]
    unknown = [part[2] for part in parts if part and part[2] and unit_of(part[2]) is None]
    kinds = [size[1] or wanted for size, wanted in zip(sizes, ("power", "voltage"), strict=False)]
    if len(parts) != 2 or unknown or kinds != ["power", "voltage"]:
        raise SweepError(
            f"{option} is apparent power and line-to-line voltage, like 10kVA,400V; found "
            f"{text[:40]!r}."
        )
    if min(sizes[0][0], sizes[1][0]) <= 0:
        raise SweepError(f"{option} must be above zero; found {text[:40]!r}.")
    for key, size, what in zip(
        ("s_base_va", "v_base_v"), sizes, ("the power", "the voltage"), strict=True
    ):
        require_in_range(key, size[0], f"{what} of {option}")
    return sizes[0][0], sizes[1][0]


def _told(number: float, unit: str, name: str = "") -> Told:
    dimension, factor = unit_of(unit) or ("", 1.0)
    return number * factor, dimension, name, unit


def _in_hertz(told: Told) -> Told:
    """A frequency that was told in rad/s, in Hz."""
    number, dimension, name, unit = told
    return (
        (number / (2 * pi), "frequency", name, unit) if dimension == "angular frequency" else told
    )


def _number(text: str) -> float:
    return float(text.replace("−", "-").replace(",", "."))
