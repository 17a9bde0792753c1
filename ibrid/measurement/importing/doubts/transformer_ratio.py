"""Ratios of instrument transformers and probes: what words beside a recording tell of them, what is
asked, and what is said.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from ibrid.errors import SweepError

#: Words for a transformer or a probe of currents, of voltages, and of either.
_WORDS = {
    "i": r"CTs?|C\.T\.|TCs?|TIs?|current[ _-]transformers?|Stromwandler\w*|"
    r"transfo\w*\s+de\s+(?:co\w+|intens\w+)|电流互感器",
    "v": r"[PV]Ts?|T[PT]s?|(?:potential|voltage)[ _-]transformers?|Spannungswandler\w*|"
    r"transfo\w*\s+de\s+(?:tensi\w+|poten\w+)|电压互感器",
    "": r"instrument[ _-]transformers?|Wandler\w*|互感器|probes?|Tastk[oö]pfe?|dividers?|"
    r"(?:Spannungs)?teiler|sondes?|sondas?",
}
_KNOWN = {
    letter: re.compile(rf"(?<![^\W\d_])(?:{words})(?![^\W_])", re.IGNORECASE)
    for letter, words in _WORDS.items()
}
#: What is measured, where the word for the transformer leaves it open.
_MEASURED = {
    "i": re.compile(r"current|strom|courant|corriente|电流|clamp|zange|pince|rogowski", re.I),
    "v": re.compile(r"volt|spannung|tensi|电压|differen[tz]|high.?volt|\bHV\b", re.I),
}
_NUMBER = r"(\d+(?:[.,]\d+)?)\s*([kK]?)([AV]?)"
#: 1000/5, 200:1, 1000 A : 5 A.
_RATIO = re.compile(rf"(?<![\d/:.,]){_NUMBER}\s*[:/]\s*{_NUMBER}(?![\d/:])")
#: Of the voltage of a phase on both sides, which leaves their ratio as it is.
_ROOT = re.compile(r"\s*/\s*(?:√|sqrt\s*\(?|Wurzel\s*)\s*3\)?", re.IGNORECASE)
_SECONDARY = re.compile(
    r"\b(secondary|sekund(?:är|aer)\w*|secondaires?|secundari[oa]s?)\b|二次", re.IGNORECASE
)
_PRIMARY = re.compile(
    r"\b(primary|prim(?:är|aer)\w*|primaires?|primari[oa]s?)\b|一次", re.IGNORECASE
)
#: Beside "primary": that the numbers of the recording are meant.
_VALUES = re.compile(
    r"values?|quantit|referred|samples|\bside\b|werte|seite|valeurs?|côté|valores|lado|值",
    re.IGNORECASE,
)
#: A comment is quoted up to so many characters.
_QUOTED = 60
#: One side of a ratio that is said: 63000, 63kV.
_SIDE = r"(\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)([kK]?)[AV]?"
_SAID = re.compile(rf"{_SIDE}(?:\s*[:/]\s*{_SIDE})?")


@dataclass(frozen=True)
class Ratios:
    """What voltages and currents are multiplied by, from the secondary side to the primary."""

    v: float = 1.0
    i: float = 1.0

    def of(self, role: str) -> float:
        """What the numbers of a role such as va, i_mag or p are multiplied by."""
        if role in ("p", "q"):
            return self.v * self.i
        if role.endswith("_ang") or role in ("record", "sigma"):
            return 1.0
        return {"v": self.v, "i": self.i}.get(role[0], 1.0)

    @property
    def words(self) -> str:
        """What is multiplied, for a remark."""
        if self == Ratios():
            return "values of the primary side, as said"
        factors = [f"voltages times {self.v:.6g}"] * (self.v != 1.0)
        factors += [f"currents times {self.i:.6g}"] * (self.i != 1.0)
        return f"{', '.join(factors)}, to the primary side, as said"


@dataclass(frozen=True)
class TransformerDoubt:
    """A comment that tells of a transformer, a probe or of secondary values.

    letter : "v" or "i" where it tells which. ratio : as `--ratio` takes it, "" where it tells none.
    is_secondary : whether it says that values are those of the secondary side.
    """

    comment: str
    letter: str
    ratio: str
    is_secondary: bool


def ratios_said(said: object) -> Ratios | None:
    """Read `1`, for values of the primary side, or `v=63000/100,i=1000/5`; None for nothing said.

    Raises SweepError for anything else.
    """
    if said is None:
        return None
    if str(said).strip() in ("1", "1.0"):
        return Ratios()
    items = (
        [(str(letter), str(ratio)) for letter, ratio in said.items()]
        if isinstance(said, Mapping)
        else [item.partition("=")[::2] for item in str(said).split(",")]
    )
    ratios: dict[str, float] = {}
    for letter, ratio in items:
        sides = _SAID.fullmatch(ratio.strip())
        letter = letter.strip().lower().replace("u", "v")
        size = _quotient(sides) if sides else 0.0
        if letter not in ("v", "i") or letter in ratios or size <= 0:
            raise SweepError(
                "--ratio is written v=63000/100,i=1000/5, primary over secondary, or 1 for values "
                f"of the primary side; found {str(said)[:40]!r}."
            )
        ratios[letter] = size
    return Ratios(**ratios)


def _quotient(sides: re.Match[str]) -> float:
    upper, kilo, lower, other_kilo = sides.groups(default="")
    below = _size(lower, other_kilo) if lower else 1.0
    return _size(upper, kilo) / below if below else 0.0


def _size(digits: str, kilo: str) -> float:
    return float(digits.replace(",", ".")) * (1e3 if kilo else 1.0)


def transformer_doubts(comments: Iterable[str]) -> tuple[TransformerDoubt, ...]:
    """What comments tell of ratios, and of values on the secondary side; nothing where they call
    their values primary.
    """
    comments = list(dict.fromkeys(comments))
    secondary = [comment for comment in comments if _SECONDARY.search(comment)]
    if not secondary and primary_said(comments):
        return ()
    doubts: list[TransformerDoubt] = []
    for comment in comments:
        is_secondary = comment in secondary
        told = _ratios_in(comment)
        if is_secondary and not told:
            told = [("", "")]
        doubts += [TransformerDoubt(comment, *one, is_secondary) for one in told]
    return tuple(doubts)


def primary_said(comments: Iterable[str]) -> str:
    """The first comment that says that the values are those of the primary side; "" for none."""
    return next((one for one in comments if _PRIMARY.search(one) and _VALUES.search(one)), "")


def _ratios_in(comment: str) -> list[tuple[str, str]]:
    """Letter and ratio of each ratio of a transformer or probe in a comment."""
    if not any(word.search(comment) for word in _KNOWN.values()):
        return []
    comment = _ROOT.sub("", comment)
    told = []
    begin = 0
    for sides in _RATIO.finditer(comment):
        upper, kilo, unit, lower, other_kilo, other_unit = sides.groups()
        sizes = sorted([_size(upper, kilo), _size(lower, other_kilo)])
        letter = {"A": "i", "V": "v"}.get(unit or other_unit)
        own = comment[begin : sides.start()], re.split("[,;]", comment[sides.end() :])[0], comment
        letter = letter or next(filter(None, map(_measured, own)), "")
        begin = sides.end()
        if 0 < sizes[0] < sizes[1]:
            ratio = f"{sizes[1]:g}" + ("" if sizes[0] == 1 else f"/{sizes[0]:g}")
            told.append((letter, ratio))
    return told


def _measured(words: str) -> str:
    """Whether words tell of currents or voltages: of the last that does "i" or "v", else ""."""
    ends = {
        letter: max(
            (
                match.end()
                for pattern in (_KNOWN[letter], _MEASURED[letter])
                for match in pattern.finditer(words)
            ),
            default=0,
        )
        for letter in "iv"
    }
    if ends["i"] == ends["v"]:
        return ""
    return max(ends, key=lambda letter: ends[letter])


def ratio_question(doubts: Iterable[TransformerDoubt], settled: Collection[str]) -> str:
    """What must be said of the ratios that comments tell of, with the options; "" for nothing.

    settled : "v" and "i", of which another option says what their numbers are.
    """
    asked = [one for one in doubts if not (one.letter and one.letter in settled)]
    if not asked or {"v", "i"} <= {*settled}:
        return ""
    quoted = dict.fromkeys(repr(one.comment.strip()[:_QUOTED]) for one in asked)
    ratios = {one.letter: one.ratio for one in reversed(asked) if one.letter and one.ratio}
    ratios = ratios or {
        letter: example
        for letter, example in (("v", "63000/100"), ("i", "1000/5"))
        if letter not in settled
    }
    values = ",".join(f"{letter}={ratios[letter]}" for letter in "vi" if letter in ratios)
    of_primary = "--ratio 1 if on the primary side"
    of_secondary = f"--ratio {values} if on the secondary side, whose values are multiplied by it,"
    is_secondary = any(one.is_secondary for one in asked)
    answers = [of_secondary, of_primary] if is_secondary else [of_primary, of_secondary]
    return (
        "on which side of transformers or probes its values were taken "
        f"({', '.join([*quoted][:3])}): add {' or '.join(answers)}".rstrip(",")
    )
