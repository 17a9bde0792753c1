"""A cell of anybody's table as a number: real or complex, with a point or a comma, polar, in
thousands, or empty.
"""

import re

from ibrid.measurement.importing.numbers.decimal_mark import with_point
from ibrid.measurement.importing.numbers.polar_cells import Polar, polar_of, spice_number

_EMPTY = ("", "nan", "-", "--", "–", "—", "n/a", "na", "none", "null", "nil")
#: What accountants mean as a negative number, and others as the number.
_PERHAPS_NEGATIVE = re.compile(r"\(\s*[\d.,]+(?:[eE][-+]?\d+)?\s*\)")
#: Signs that word processors and typesetters write for a minus.
_MINUS = re.compile("[−–—‐‑]")
#: What parts thousands in Switzerland: 1'255.9.
_THOUSANDS = re.compile(r"(?<=\d)['’](?=\d{3}(?!\d))")
#: Characters of a number.
LONGEST_NUMBER = 100


def number(text: str, comma: bool, *, radians: bool = False) -> complex | None:
    """A cell as a number, NaN where it is empty; complex as 1+2i, (1-2j), 1+j2, 3∠-45°; 1,255.9 in
    thousands; None for text.

    comma : whether a comma may be the decimal mark, as it is then in 1,234; a point of 1.234 parts
    thousands then. radians : whether polar angles without a unit are in rad. A plain (0.5) is none:
    accountants mean -0.5, others 0.5.
    """
    try:
        if not comma:
            return complex(float("" if "_" in text else text))
        if "." not in text:
            return complex(float("" if "_" in text else text.replace(",", ".")))
    except ValueError:
        pass
    text = text.strip().strip("'\"")
    if len(text) > LONGEST_NUMBER:
        return None
    if text.lower() in _EMPTY:
        return complex("nan")
    if (of_spice := spice_number(text)) is not None:
        return of_spice
    plain = _plain(text, comma)
    if plain is None:
        return None
    try:
        return complex(float(plain))
    except ValueError:
        pass
    if polar := polar_of(plain):
        return polar.value(radians=radians)
    text = re.sub(r"[iIJ]", "j", re.sub(r"(?<=\d)[dD](?=[-+]?\d)", "e", plain)).replace("+-", "-")
    text = re.sub(r"j([.\d][.\deE]*(?:(?<=[eE])[-+]\d+)?)$", r"\1j", text)
    try:
        return complex(text)
    except ValueError:
        return None


def polar_cell(text: str, comma: bool) -> Polar | None:
    """Magnitude and angle of a cell; None where it is not polar."""
    plain = _plain(text.strip().strip("'\""), comma) if len(text) <= LONGEST_NUMBER else None
    return None if plain is None else polar_of(plain)


def _plain(text: str, comma: bool) -> str | None:
    """A cell with decimal points and without blanks; None where that cannot be a number."""
    if _PERHAPS_NEGATIVE.fullmatch(text):
        return None
    text = _THOUSANDS.sub("", _MINUS.sub("-", text))
    if comma or "," in text:
        text = with_point(text, comma)
    apart = re.search(
        r"\d[ \t]+[\d.]", text
    )  # blanks that do not break lines part thousands, others numbers
    text = re.sub(r"[\s*]", "", text.strip("()"))
    return None if apart or "_" in text else text
