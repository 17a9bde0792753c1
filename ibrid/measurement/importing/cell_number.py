"""A cell of anybody's table as a number: real or complex, with a point or a comma, polar, in
thousands, or empty.
"""

import re

import numpy as np

from ibrid.measurement.importing.numbers.decimal_mark import with_point

_EMPTY = ("", "nan", "-", "--", "n/a", "na", "none", "null", "nil")
#: What accountants mean as a negative number, and others as the number.
_PERHAPS_NEGATIVE = re.compile(r"\(\s*[\d.,]+(?:[eE][-+]?\d+)?\s*\)")
#: Characters of a number.
LONGEST_NUMBER = 100


def number(text: str, comma: bool) -> complex | None:
    """A cell as a number, NaN where it is empty; complex as 1+2i, (1-2j), 1+j2, 3∠-45°; 1,255.9 in
    thousands; None for text.

    comma : whether a comma may be the decimal mark, as it is then in 1,234; a point of 1.234 parts
    thousands then. A plain (0.5) is none: accountants mean -0.5, others 0.5.
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
    if _PERHAPS_NEGATIVE.fullmatch(text):
        return None
    if comma or "," in text:
        text = with_point(text, comma)
    apart = re.search(
        r"\d[ \t]+[\d.]", text
    )  # blanks that do not break lines part thousands, others numbers
    text = re.sub(r"[\s*]", "", text.replace("−", "-").strip("()"))
    if apart or "_" in text:
        return None
    try:
        return complex(float(text))
    except ValueError:
        pass
    polar = re.fullmatch(r"([-+.\deE]+)[∠<]([-+.\deE]+)°?", text)
    text = re.sub(r"[iIJ]", "j", re.sub(r"(?<=\d)[dD](?=[-+]?\d)", "e", text)).replace("+-", "-")
    text = re.sub(r"j([.\d][.\deE]*(?:(?<=[eE])[-+]\d+)?)$", r"\1j", text)
    try:
        return (
            complex(float(polar[1]) * np.exp(1j * np.deg2rad(float(polar[2]))))
            if polar
            else complex(text)
        )
    except ValueError:
        return None
