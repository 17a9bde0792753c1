"""Words beside a recording that tell of instrument transformers: its values may be those of the
secondary side.
"""

import re
from collections.abc import Iterable

_TRANSFORMER = re.compile(
    r"\b(CTs?|C\.T\.|PTs?|VTs?|TCs?|TPs?|TIs?|CT[ _]?ratio|(?:current|potential|voltage|instrument)"
    r"[ _-]transformers?|(?:Strom|Spannungs)?wandler\w*|transfo\w*\s+de\s+\w+)\b|互感器",
    re.IGNORECASE,
)
#: 1000/5, 200:1, 1000 A : 5 A.
_RATIO = re.compile(r"\d+(?:[.,]\d+)?\s*[kK]?[AV]?\s*[:/]\s*\d+(?:[.,]\d+)?\s*[AV]?(?![\d/])")
_SECONDARY = re.compile(
    r"\b(secondary|sekund(?:är|aer)\w*|secondaires?|secundari[oa]s?)\b|二次", re.I
)


def transformer_doubts(comments: Iterable[str]) -> tuple[str, ...]:
    """A sentence for each comment that tells of a ratio or of values on the secondary side."""
    doubts = []
    for comment in comments:
        has_ratio = _TRANSFORMER.search(comment) and _RATIO.search(comment)
        if has_ratio or _SECONDARY.search(comment):
            doubts.append(
                f"{comment.strip()[:80]!r}: taken as values of the primary side; if they are of "
                "the secondary one, multiply them by the ratio of their transformers first"
            )
    return tuple(dict.fromkeys(doubts))
