"""The error measures of a standard, row by row, for a page and for a terminal."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

#: Measures in the order of the columns, and what signals are called.
MEASURES = ("mxe", "me", "mae")
CALLED = {"p": "P", "q": "Q", "ip": "Ip", "iq": "Iq"}


@dataclass(frozen=True)
class ValidationRow:
    """One signal in one window of a record.

    `values`, `unfiltered`, `limits` : MXE, ME and MAE, per unit.
    """

    record: str
    window: str
    between: tuple[float, float]
    reference: str
    signal: str
    values: tuple[float, ...]
    unfiltered: tuple[float, ...]
    limits: tuple[float, ...]
    passes: bool

    @property
    def word(self) -> str:
        """Whether it passes."""
        return "pass" if self.passes else "FAIL"


def rows_of(validation: Mapping[str, Any]) -> Iterator[ValidationRow]:
    """The rows of what `ibrid.playback.validation` finds."""
    for window in validation["windows"]:
        for signal, measured in window["signals"].items():
            yield ValidationRow(
                window["record"],
                window["name"],
                tuple(window["t"]),
                window["reference"],
                CALLED.get(str(signal), str(signal)),
                tuple(measured[key] for key in MEASURES),
                tuple(measured.get("unfiltered", measured)[key] for key in MEASURES),
                tuple(measured["limit"][key] for key in MEASURES),
                measured["pass"],
            )


def validation_sentence(validation: Mapping[str, Any]) -> str:
    """Whether all measures are within their limits."""
    rows = [*rows_of(validation)]
    failed = [one for one in rows if not one.passes]
    if not rows:
        return "IEC 61400-27-2: no record has a window to be judged in."
    verdict = "pass" if not failed else f"{len(failed)} of {len(rows)} signals FAIL"
    return f"IEC 61400-27-2, limits of RTE: {verdict}."
