"""What the name of a column in time says: voltage or current, of which phase, magnitude or angle,
and in what unit.

Names come as programs and recorders write them: `Va (kV)`, `MTB\\fft_pos_Id_pu`, `m:uA in kV`,
`s:ppoc_pu`, `V:1`, `VA_ang`.
"""

import re
import tomllib
import unicodedata
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from ibrid.measurement.importing.column_words import CONJUGATE_SIGN, WIDE

_WORDS = tomllib.loads(
    (files("ibrid.measurement.importing.timed") / "signal_words.toml").read_text(encoding="utf-8")
)
_PREFIXES = {
    "u": 1e-6,
    "µ": 1e-6,
    "μ": 1e-6,
    "m": 1e-3,
    "k": 1e3,
    "K": 1e3,
    "M": 1e6,
    "G": 1e9,
    "n": 1e-9,
}
_UNITS = {word: dimension for dimension, words in _WORDS["units"].items() for word in words}
_PLACE = re.compile(_WORDS["places"]["words"])
_QUANTITIES: dict[str, str] = _WORDS["quantities"]
_PHASES: dict[str, str] = _WORDS["phases"]
_PARTS: dict[str, str] = _WORDS["parts"]
#: What a name, a unit and words beside it may say of how a size is counted.
_COUNTED = {
    "rms": "rms|eff|trms",
    "peak": "peak|pk|crest|spitze",
    "line": "ll|l-l|line|linetoline|leiter|außenleiter\\w*|verkettete|composée|entre phases|"
    "l[ií]nea|compuesta|concatenata",
    "phase": "ln|l-n|lg|l-g",
}
#: Those that stand behind the name of a voltage: U_LN, V_LL_rms, U peak.
_COUNTED_WORD = re.compile(rf"[\s_]+({'|'.join(_COUNTED.values())})(?![A-Za-z])", re.IGNORECASE)
#: Where a voltage or current was taken, written between its letter and its phase.
_AT = "g|grid|pcc|poc|poi|out|[so](?=[dq])"
#: How PowerFactory and EMTP begin the name of a variable: monitored, signal, bus, calculation,
#: element; and RSCAD, with a number.
_PROGRAM = re.compile(r"^[msbner]:(?=[A-Za-z])|^S\d+\)\s*")
#: PowerFactory's angle of a voltage or current: phiu1, phii1.
_ANGLE_OF = re.compile(r"phi([uvi])1?")
#: An object of the network before the name of its variable: `Terminal: Voltage, Magnitude`.
_OF_OBJECT = re.compile(r".*?[^:\s]:\s+(\S[^:]*)")
#: How a clock is written, in brackets.
_CLOCK_FORM = re.compile(r"\s*[\[({][^\[\](){}]*[hH]{1,2}:[mM]{2}[^\[\](){}]*[\])}]$")
#: Units that stand behind a name without brackets.
_BEHIND = re.compile(
    r"(.+?)(?:\s+in\s+|\s*/\s*|[_\s](?![VA]$))((?:k|K|M|m)?(?:V|A)|[kM]?W|[kM]?[vV][aA][rR]|[kM]?VA|p\.?u\.?|deg|rad|Hz|ms|us|sec|s|%)"
)
#: A unit in the middle of a name.
_PER_UNIT = re.compile(r"(?:(?<![A-Za-z])pu|(?<=[a-z])Pu)(?![A-Za-z])|p\.u\.")
#: A column of an array of three phases, or of d and q.
_ARRAY = re.compile(r"(.*[vuiVUI][A-Za-z_]*?)(abc|ABC|dq0?|DQ0?)\w*[:(_ ]+([123])\)?$")
_OF_ARRAYS = {"a": "abc", "d": "dq0"}
_BRACKETS = re.compile(r"\[([^\[\]]{1,20})\]|\(([^()]{1,20})\)|\{([^{}]{1,20})\}")


@dataclass(frozen=True)
class ColumnSignal:
    """A column in time.

    `quantity` : v, i, p, q, ip, iq (active and reactive current), t, f, record, sigma, or "" for
    what is not understood. `phase` : a, b, c, ab, bc, ca, d, q, pos or "". `part` : mag, ang, re,
    im or "". `dimension`, `factor` : of its unit, "" for none. `counted` : "rms", "peak", "line"
    and "phase", as far as it is said.
    """

    quantity: str = ""
    phase: str = ""
    part: str = ""
    dimension: str = ""
    factor: float = 1.0
    counted: frozenset[str] = frozenset()

    @property
    def role(self) -> str:
        """va .. ic, vab .. vca, vd .. iq, p, q, t, with the part behind: va_mag."""
        return self.quantity + self.phase + (f"_{self.part}" if self.part else "")


def signal_of(name: str, unit: str = "", phase: str = "") -> ColumnSignal:
    """Read the name of a column with its unit and phase where they stand apart; `ColumnSignal()`
    where it says nothing known, or has the star of a reference.
    """
    name = without_clock_form(name)
    if name.strip().lower() in ("record", "sigma"):
        return ColumnSignal(name.strip().lower())
    bare, written = (name, unit) if unit.strip() else split_unit(name)
    if not written and (apart := _PER_UNIT.search(bare)):
        bare, written = f"{bare[: apart.start()]} {bare[apart.end() :]}".strip(), "pu"
    if CONJUGATE_SIGN.search(bare):
        return ColumnSignal()
    dimension, factor = size_of(written) or ("", 1.0)
    counted = counted_in(f"{written} {name}")
    quantity, axis, part = _meaning(bare, phase)
    if not quantity and (said := _OF_OBJECT.fullmatch(bare)):
        quantity, axis, part = _meaning(said[1], phase)
    if not quantity and counted and _meaning(_COUNTED_WORD.sub(" ", bare), phase) == ("v", "", ""):
        quantity, part = "v", "mag"
    if dimension == "angle" and (said := _ANGLE_OF.fullmatch(_PROGRAM.sub("", bare.strip()))):
        quantity, axis, part = ("v" if said[1] in "uv" else "i"), "", "ang"
    if quantity == "v" and part == "ang" and dimension in ("voltage", "per unit"):
        axis, part = _between_phases(bare, axis) or (axis, part)
    if quantity and dimension and not _fits(quantity, part, dimension):
        quantity, axis, part = "", "", ""
    if dimension == "angle" and part == "":
        part = "ang"
    return ColumnSignal(quantity, axis, part, dimension, factor, counted)


def _between_phases(name: str, phase: str) -> tuple[str, str] | None:
    """Phase and part of Vba and Vca in V, which in degrees are the angles of Vb and Vc."""
    pair = f"{phase}a"
    return (pair, "") if pair in _PHASES and _plain(name).endswith(pair) else None


def without_clock_form(name: str) -> str:
    """The name of a column without how its clock is written: Zeit [hh:mm:ss.000]."""
    return _CLOCK_FORM.sub("", name).strip()


def split_unit(name: str) -> tuple[str, str]:
    """A name and the unit in it: in brackets, or behind it after " in ", a slash, an underscore or
    a blank; "" for none.
    """
    name = name.translate(WIDE)
    for bracket in _BRACKETS.finditer(name):
        inner = next(text for text in bracket.groups() if text)
        if size_of(inner):
            return f"{name[: bracket.start()]} {name[bracket.end() :]}".strip(), inner
    if (matched := _BEHIND.fullmatch(name.strip())) and size_of(matched[2]):
        return matched[1], matched[2]
    return name, ""


def size_of(unit: str) -> tuple[str, float] | None:
    """What a unit measures, and its size in V, A, W, s, Hz, degrees or per unit; None for no
    unit.
    """
    word = re.sub(
        r"([\s_-]*(rms|rrms|eff|peak|pk|ll|l-l|ln|l-n|l-g|lg))+$",
        "",
        unit.strip(),
        flags=re.IGNORECASE,
    )
    if word == "%":
        return "per unit", 0.01
    known = _UNITS.get(word.lower())
    if known:
        return ("angle", 57.29577951308232) if known == "angle in radians" else (known, 1.0)
    plain = _UNITS.get(word[1:].lower()) if len(word) > 1 and word[0] in _PREFIXES else None
    if plain in (None, "per unit", "angle", "angle in radians"):
        return None
    is_mega = plain == "power" and word[0] == "m"  # mw, mvar of pandapower
    return plain, 1e6 if is_mega else _PREFIXES[word[0]]


def counted_in(words: str) -> frozenset[str]:
    """How a size is counted, as its unit or name says: `kV_LL`, `A pk`."""
    return frozenset(word for word, pattern in _COUNTED.items() if _says(pattern, words))


def _says(pattern: str, words: str) -> bool:
    return (
        re.search(rf"(?<![A-Za-z])({pattern})(?![A-Za-z])", words.replace("_", " "), re.IGNORECASE)
        is not None
    )


def _fits(quantity: str, part: str, dimension: str) -> bool:
    if part == "ang":
        return dimension == "angle"
    usual = {
        "v": "voltage",
        "i": "current",
        "ip": "current",
        "iq": "current",
        "p": "power",
        "q": "power",
    }
    usual |= {"t": "time", "f": "frequency"}
    return dimension in (usual[quantity], "per unit") or (dimension == "angle" and quantity in "vi")


@cache
def _patterns() -> tuple[re.Pattern[str], ...]:
    """Quantity, phase and part in the orders in which names have them."""
    v_or_i = "|".join(f"(?P<{quantity}>{_QUANTITIES[quantity]})" for quantity in "vi")
    phase = "|".join(f"(?P<ph_{name}>{words})" for name, words in _PHASES.items())
    part = "|".join(f"(?P<pt_{name}>{words})" for name, words in _PARTS.items())
    lead = "(?:pos|fund|h1)?"
    return tuple(
        re.compile(pattern)
        for pattern in (
            rf"{lead}(?:{v_or_i})(?:{_AT})?(?:{phase})?[ng]?(?:{part})?",
            rf"{lead}(?:{v_or_i})(?:{part})(?:{phase})?[ng]?",
            rf"(?:ph|phase|phaseseq)?(?:{phase})(?:{v_or_i})(?:{part})?",
            rf"(?:{part})(?:{v_or_i})(?:{phase})?",
            rf"(?:{phase})(?:{part})(?:{v_or_i})",
            rf"(?:{v_or_i})(?P<ph_pos>p)(?:{part})",
        )
    )


def _meaning(name: str, phase: str) -> tuple[str, str, str]:
    """Quantity, phase and part of a name without its unit."""
    leaf = _PROGRAM.sub("", re.split(r"[\\/|>]", name.strip())[-1].strip())
    leaf = _ARRAY.sub(lambda said: said[1] + _OF_ARRAYS[said[2].lower()[0]][int(said[3]) - 1], leaf)
    words = [_plain(word) for word in _tokens(leaf)]
    kept = [word for word in words if word and not _PLACE.fullmatch(word)] or words
    for compact in dict.fromkeys(("".join(kept), "".join(words), *_without_place("".join(kept)))):
        for quantity, pattern in _QUANTITIES.items():
            if quantity not in "vi" and re.fullmatch(pattern, compact):
                return quantity, "", ""
        for pattern in _patterns():
            if matched := pattern.fullmatch(compact):
                groups = matched.groupdict()
                quantity = next(name for name in "vi" if groups[name])
                named = next(
                    (one[3:] for one in groups if one.startswith("ph_") and groups[one]), ""
                )
                part = next(
                    (one[3:] for one in groups if one.startswith("pt_") and groups[one]), ""
                )
                if named == "other":
                    return "", "", ""
                return quantity, _phase_said(phase) or named, part
    return "", "", ""


def _tokens(leaf: str) -> list[str]:
    apart = re.sub(
        r"(?<=[a-z])(?=[A-Z][a-z])|(?<=[A-Z])(?=[A-Z][a-z]{2})",
        " ",
        re.sub("相|(?<=[A-Za-z])상", "", leaf),
    )
    return re.split(r"[^\w]+|_+", apart)


def _plain(word: str) -> str:
    apart = unicodedata.normalize("NFKD", word.lower())
    return unicodedata.normalize("NFC", re.sub(r"[\W_]", "", apart))


def _without_place(compact: str) -> list[str]:
    """A name without the place that is written on to it: ppoc, vapcc, pccva."""
    return [
        re.sub("(pcc|poc|poi|pdr)$", "", compact),
        re.sub("^(pcc|poc|poi|pdr|bus|grid)", "", compact),
    ]


def _phase_said(phase: str) -> str:
    plain = _plain(phase).removesuffix("n")
    return next(
        (name for name, words in _PHASES.items() if plain and re.fullmatch(words, plain)), ""
    )
