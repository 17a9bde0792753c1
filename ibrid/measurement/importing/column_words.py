"""What the name of a column says: which number stands there, which entry and which part of it, and
in what unit.

Names come as scan tools, laboratories and colleagues write them: `Re(Ydd)/S`, `Z_dq_mag (dB)`,
`Zdut_dq_11_re`, `f [kHz]`.
"""

import re
import tomllib
import unicodedata
from dataclasses import dataclass, replace
from importlib.resources import files

_WORDS = tomllib.loads(
    (files("ibrid.measurement.importing") / "column_words.toml").read_text(encoding="utf-8")
)
#: Unit in small letters -> what it measures and its size in the plain unit of that.
UNITS = {word: (dimension, 1.0) for dimension, words in _WORDS["units"].items() for word in words}
UNITS |= {"%": ("per unit", 0.01)}
#: Voltages of a phase, as those between the phases, rms.
UNITS |= {
    "v_ln": ("voltage", 3**0.5),
    "v_pk": ("voltage", 1.5**0.5),
    "v_peak": ("voltage", 1.5**0.5),
}
#: Brackets as wide as letters of Chinese.
WIDE = str.maketrans("（）［］", "()[]")
_PREFIXED = {"u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "K": 1e3, "M": 1e6, "G": 1e9}
_PARTS: dict[str, str] = _WORDS["parts"]
BESIDE: dict[str, str] = _WORDS["beside"]
_PART = "|".join(f"(?P<{{0}}{part}>{words})" for part, words in _PARTS.items())
#: Parts as one letter, which stand behind an entry alone: yddr, yddi.
_LETTERS = {"re": "|r", "im": "|i"}
_PART_BEHIND = "|".join(
    f"(?P<b{part}>{words}{_LETTERS.get(part, '')})" for part, words in _PARTS.items()
)
_QUANTITY = (
    r"(?P<letter>[yzgbrx])(?P<of_letter>[a-z]{0,9}?)|"
    r"(?P<word>admittance|impedance|adm|imp|阻抗|导纳|임피던스|어드미턴스|responsedata)(?P<of_word>[a-z]{0,9}?)"
)
#: Words behind Y or Z with which the numbers are others than those of the inverter as it stands.
_CHANGES = re.compile(_WORDS["of"]["changes"])
#: Words behind Y or Z with which they are those of the inverter.
_KNOWN_OF = re.compile(_WORDS["of"]["inverter"])
#: A star, prime or dagger, which may conjugate; not the star of a product nor quotation marks.
CONJUGATE_SIGN = re.compile(
    r"\*(?!\s*[\w(|])|[A-Za-z]\*|[′†‡]|(?<=[YZyz])'|(?<=[YZyz][dqpn12]{2})'(?![,)])"
)
#: From which axis to which one: `q->d`.
_ARROW = re.compile(
    r"([dqpn12])\s*(?:[-=]+>|→|⇒|(?<![^\W_].)\s+to\s)\s*([dqpn12])(?![^\W_])", re.IGNORECASE
)
_ENTRY = r"(?P<entry>dd|dq|qd|qq|pp|pn|np|nn|[12][12])"
_ALONE = r"(?P<entry>positivesequence|positive|posseq|pos|p|1|plus)"
_BEFORE = rf"(?:{_PART.format('a')})?(?:of|de|von)?(?:{_QUANTITY})??"
_BEHIND = rf"(?:sequence)?(?:impedance|admittance)?(?:in)?(?:{_PART_BEHIND})?"
_MATRIX, _POSITIVE = (re.compile(_BEFORE + entry + _BEHIND) for entry in (_ENTRY, _ALONE))
_SIGMA = re.compile(rf"(?:sigma|std|stddev|sd|uncertainty)(?:[yz])?(?:{_ENTRY})?")
ROLE_NAMES: dict[str, str] = {
    part: f"(value|y|z)?({words})|({words})(of)?[yz]" for part, words in _PARTS.items()
} | _WORDS["roles"]
_DIMENSIONS = {
    "freq": ("frequency",),
    "omega": ("angular frequency",),
    "v": ("voltage", "per unit"),
}
_DIMENSIONS |= dict.fromkeys("pq", ("power", "per unit"))
_PER_SECOND = (("omega", "1/s"), ("omega", "s^-1"))
#: What answers to what: id/vq is Ydq, vd/iq is Zdq.
_ANSWER = re.compile(r"\b(?:(i)|[vu])_?([dq])\s*/\s*(?(1)[vu]|i)_?([dq])(?![^\W_])", re.IGNORECASE)
_RADIANS = re.compile(
    r"(k?)rad(?:ian)?s?[\s_]*+(?:/|per|p|[.·*_])?[\s_]*+s(?:ec(?:ond)?s?)?(?:\^?-1)?", re.IGNORECASE
)
# a run of blanks is looked at from its beginning alone
_UNIT_AT_END = re.compile(
    rf"(.+?)(?:(?<!\s)\s*/\s*|(?<!\s)\s+in\s+|(?<![\s_])[\s_]+)({_RADIANS.pattern}|[A-Za-zΩµμ°%./]{{1,40}})"
)
#: How PowerFactory begins the name of a variable: of a bus, monitored, calculated.
_PROGRAM = re.compile(r"^[a-z]:(?=[A-Za-z])")
_NUMBERED = {"11": "dd", "12": "dq", "21": "qd", "22": "qq"}
_SEQUENCE = {"11": "pp", "12": "pn", "21": "np", "22": "nn"}


@dataclass(frozen=True)
class Meaning:
    """What a column holds.

    `role` : "freq", "omega", "op", "p", "q", "v", "sigma", "repeat", "amplitude", "entry" (names of
    entries), "matrix", "positive" (sequence alone), "re" .. "phase" (of the entry that the row or
    the file names), or "" for what is not understood. `letter` : Y, Z or "". `entry` : dd .. qq, pp
    .. nn. `part` : re, im, mag, phase or "" for a complex number. `unit` : a word of the name;
    `dimension`, `factor` : what it measures, and its size. `of` : the word behind Y or Z. `doubt` :
    the sign or word of a name that would be understood without it, but may be that of a conjugate,
    a negative or another device; its `role` is "".
    """

    role: str = ""
    letter: str = ""
    entry: str = ""
    part: str = ""
    unit: str = ""
    dimension: str = ""
    factor: float = 1.0
    of: str = ""
    doubt: str = ""


def meaning_of(name: str) -> Meaning:
    """Read the name of a column; `Meaning()` where it says nothing known."""
    name = _ANSWER.sub(lambda said: f"{'Y' if said[1] else 'Z'}{said[2]}{said[3]}", name)
    meaning = _meaning(_PROGRAM.sub("", name.strip()))
    if not meaning.role and ": " in name:
        meaning = _behind_labels(name, meaning)
    sign = CONJUGATE_SIGN.search(without_unit(name)[0])
    changed = _CHANGES.search(meaning.of)
    doubt = sign[0] if sign else changed[0] if changed else ""
    if not meaning.role or not doubt:
        return meaning
    return Meaning(
        unit=meaning.unit, dimension=meaning.dimension, factor=meaning.factor, doubt=doubt
    )


def _behind_labels(name: str, meaning: Meaning) -> Meaning:
    """What a part says that stands behind labels: `Trace 1: Impedance: Magnitude (dBΩ)` of network
    analysers; the meaning as it was where there is none.
    """
    labels, _, behind = name.rpartition(": ")
    part = _meaning(behind)
    if part.role not in _PARTS:
        return meaning
    quantity = next((word for word in ("admittance", "impedance") if word in labels.lower()), "")
    return replace(part, letter=_letter(part.letter, quantity))


def is_known_word(word: str) -> bool:
    """Whether a word behind Y or Z is one of the inverter itself: Zdut, Yvsc."""
    return _KNOWN_OF.fullmatch(word) is not None


def _meaning(name: str) -> Meaning:
    bare, unit = without_unit(name)
    dimension, factor = unit_of(unit) or ("", 1.0)
    measured = {"unit": unit, "dimension": dimension, "factor": factor}
    compact = letters_of(re.sub(r" #\d+$", "", bare))
    for role, pattern in ROLE_NAMES.items():
        if re.fullmatch(pattern, compact) and role in _DIMENSIONS:
            radians = role in ("freq", "omega") and dimension == "angle in radians"
            if radians or (role, unit) in _PER_SECOND:
                measured["dimension"] = dimension = "angular frequency"  # freq_rad, omega [1/s]
            if role == "freq" and dimension == "angular frequency":
                role = "omega"
            if not dimension or dimension in _DIMENSIONS[role]:
                return Meaning(role, **measured)
    sigma = _SIGMA.fullmatch(compact)
    if sigma:
        return Meaning("sigma", entry=_entry(sigma["entry"] or "", compact), **measured)
    matched = _MATRIX.fullmatch(compact)
    if matched is None:
        for role, pattern in ROLE_NAMES.items():
            if re.fullmatch(pattern, compact) and role not in _DIMENSIONS:
                # the y of "imaginary" is not the letter Y
                is_word = re.fullmatch(_PARTS.get(role, compact), compact)
                ends = () if is_word else (compact[0], compact[-1])
                letter = next((end.upper() for end in ends if end in "yz"), "")
                return Meaning(role, letter=_letter(letter, dimension), **measured)
        of = _letter("", dimension)
        for part, pattern in _WORDS["alone"].get(of, {}).items():
            if re.fullmatch(pattern, compact):
                return Meaning(part, letter=of, **measured)
        matched = _POSITIVE.fullmatch(compact)
        if matched is None or not (
            matched["letter"] or matched["word"] or matched["entry"].startswith(("pos", "plus"))
        ):
            return Meaning(**measured)
    groups = matched.groupdict()
    of = groups["of_letter"] or groups["of_word"] or ""
    part = next((part for part in _PARTS for side in "ab" if groups[f"{side}{part}"]), "")
    if not part and (behind := [one for one, words in _PARTS.items() if re.fullmatch(words, of)]):
        part, of = behind[0], ""  # Zreal_dd
    word = (groups["word"] or "").replace(
        "responsedata", ""
    )  # of a frd of MATLAB, which does not say of what
    letter = (groups["letter"] or word[:1].translate(str.maketrans("ai导阻어임", "yzyzyz"))).upper()
    letter = letter or "Z" * (groups["entry"] == "plus")  # Ph+ of PSCAD, beside Z+
    if letter in ("R", "X", "G", "B"):
        part, letter = part or ("re" if letter in "RG" else "im"), "Z" if letter in "RX" else "Y"
    if not part:
        part = "mag" if "|" in name else "phase" if re.search("[∠<]", name) else ""
    if not part and (found := re.search("decibel|angle|db|deg", f"{dimension} {compact}")):
        part = "mag" if found[0] in ("decibel", "db") else "phase"
    role = "matrix" if matched.re is _MATRIX else "positive"
    entry = _entry(groups["entry"], compact) if role == "matrix" else "pp"
    if "db" in compact and not dimension:
        measured |= {"unit": "dB", "dimension": "decibel"}
    if part == "phase" and not dimension and re.search("deg|rad", compact):
        measured |= (
            {"unit": "deg", "dimension": "angle"}
            if "deg" in compact
            else {"dimension": "angle in radians"}
        )
    return Meaning(role, _letter(letter, dimension), entry, part, **measured, of=of)


def letters_of(name: str) -> str:
    """Small letters, without accents, and digits alone; + as a word, and what an arrow leads to
    before what it comes from: dq of q->d.
    """
    turned = _ARROW.sub(r"\2\1", name.lower().replace("+", "plus"))
    return unicodedata.normalize("NFC", re.sub(r"[\W_]", "", unicodedata.normalize("NFKD", turned)))


def without_unit(name: str) -> tuple[str, str]:
    """A name and the unit in it: behind it in brackets, after a slash, " in " or an underscore; ""
    where there is none.
    """
    name = name.translate(WIDE)
    for bracket in re.finditer(r"\[([^\[\]]+)\]|\(([^()]+)\)|\{([^{}]+)\}", name):
        inner = next(text for text in bracket.groups() if text).strip()
        for word in (inner, *re.split(r"[,;]\s*", inner)):
            if unit_of(word):
                return (name[: bracket.start()] + name[bracket.end() :]).strip(), word.strip()
    matched = _UNIT_AT_END.fullmatch(name.strip())
    if matched and unit_of(matched[2]) and matched[1].strip():
        return matched[1].strip(), matched[2]
    return name, ""


def unit_of(word: str) -> tuple[str, float] | None:
    """What a unit measures and its size in Hz, rad/s, S, ohm, per unit, W, V or degrees; None for
    no unit. No inverter delivers milliwatts: mW is MW.
    """
    word = word.strip()
    if radians := _RADIANS.fullmatch(word):
        return "angular frequency", 1e3 if radians[1] else 1.0
    known = UNITS.get(word) or UNITS.get(word.lower())
    if known is None and len(word) > 1 and word[0] in _PREFIXED:
        plain = UNITS.get(word[1:]) or UNITS.get(word[1:].lower())
        if plain and plain[0] not in ("per unit", "decibel", "angle"):
            is_mega = plain[0] == "power" and word[0] == "m"  # mw, mvar of pandapower
            known = plain[0], (1e6 if is_mega else _PREFIXED[word[0]]) * plain[1]
    return known


def unit_of_matrix(word: str) -> tuple[str, float] | None:
    """What a unit of matrices measures, also of their decibels: S and ohm behind dB. None for no
    unit. A small s makes a plural of dB.
    """
    known = unit_of(word)
    if known is None or known[0] != "decibel":
        return known
    rest = word.strip()[2:].strip("() ")
    return unit_of(rest) if rest not in ("", "s") else known


def entry_named(cell: str) -> str:
    """The entry that a cell or the end of a file's name means: dd .. qq, pp .. nn, "" for none."""
    matched = re.search(
        r"(?:^|[^a-z0-9]|[yz])(dd|dq|qd|qq|pp|pn|np|nn|[12][\s,_]?[12])[^a-z0-9]*$",
        cell.strip().lower(),
    )
    return _entry(re.sub(r"[\s,_]", "", matched[1]), cell.lower()) if matched else ""


def _entry(found: str, compact: str) -> str:
    sequence = re.search("pn|seq|012", compact) is not None
    return (_SEQUENCE if sequence else _NUMBERED).get(found, found)


def _letter(letter: str, dimension: str) -> str:
    return letter or {"admittance": "Y", "impedance": "Z"}.get(dimension, "")
