"""The configuration of a COMTRADE record as recorders write it, made into one that the standard
(C37.111) knows.

What vendors leave out, pad, or write another way, and the `comtrade` library then refuses or
misreads: fields and lines that are empty or missing, times without a fraction, end-of-file marks,
other separators, more samples announced than there are.
"""

import re
from dataclasses import dataclass

import numpy as np

from ibrid.ranges import require_in_range

#: Bytes of one analog value.
_WIDTH = {"BINARY": 2, "BINARY32": 4, "FLOAT32": 4}
_TIME = re.compile(r"\d+:\d+:\d+(?:\.(\d+))?")
_FIELDS = 13


@dataclass(frozen=True)
class PlainCfg:
    """`text` : a configuration of revision 1991 or 1999.

    `missing` : how many samples are announced and not there. `beyond` : how many stand behind those
    announced and continue them, so that they are read; `left_out` : and do not continue them.
    """

    text: str
    missing: int
    beyond: int
    left_out: int


def plain_cfg(text: str, data: bytes) -> PlainCfg:
    """The configuration for the samples in `data`, in the form of the standard.

    Channels of states, at which nobody looks here, are left out of ASCII data. Raises ValueError
    for a line without meaning, and where rows do not hold the channels that are announced.
    """
    lines = _Lines(text)
    *_, year = ["", *lines.fields()]
    revision = "1999" if re.fullmatch(r"\d{4}", year) and int(year) >= 1999 else "1991"
    counts = lines.next()
    analog, states = (
        int(found[1]) if (found := re.search(rf"(?<!\d)(\d+)\s*{kind}", counts, re.I)) else 0
        for kind in "AD"
    )
    if not analog:
        raise ValueError(
            f"line {lines.number} must announce analog channels such as 6,6A,0D, found "
            f"{counts[:40]!r}"
        )
    if analog + states > len(lines.lines):
        raise ValueError(
            f"line {lines.number} announces {analog + states} channels, more than there are lines; "
            "correct it"
        )
    channels = [_channel(lines, number) for number in range(1, analog + 1)]
    for _ in range(states):
        lines.next()
    frequency = lines.number_of_line(0.0)
    rates = _rates(lines)
    fraction = max(_fraction(lines) for _ in range(2))
    kind = lines.next().strip().upper() or "ASCII"
    multiplier = lines.number_of_line(1.0)
    widest = 2 + analog + states
    if kind == "ASCII":
        states = 0
    rows = _rows(data, kind, analog, states)
    if not rows:
        raise ValueError("there are no samples beside it")
    announced = rates[-1][1] or rows
    numbers = _numbers(data, kind, analog, states, rows)
    if kind == "ASCII":
        numbers = _of_whole_rows(data, numbers, announced, 2 + analog, widest)
    beyond, left_out = _behind(numbers, announced)
    rates[-1] = (rates[-1][0], announced + beyond)
    rates = [(rate, min(last, rows) if last else rows) for rate, last in rates]
    time = f"01/01/2000,00:00:00.{'0' * (9 if fraction > 6 else 6)}"
    plain = "\n".join(
        [
            f"station,device{',1999' if revision == '1999' else ''}",
            f"{analog + states},{analog}A,{states}D",
            *channels,
            *(f"{number},state,,,0" for number in range(1, states + 1)),
            repr(frequency),
            str(sum(rate > 0 for rate, _ in rates)),
            *(f"{rate!r},{last}" for rate, last in rates),
            time,
            time,
            kind,
            *([repr(multiplier)] if revision == "1999" else []),
            "",
        ]
    )
    return PlainCfg(plain, max(announced - rows, 0), beyond, left_out)


class _Lines:
    """Lines one by one, without marks of the end of the file; empty ones behind the last."""

    def __init__(self, text: str) -> None:
        self.lines = [line.strip() for line in re.sub("[\x1a\0\ufeff]", "", text).splitlines()]
        self.semicolons = bool(self.lines) and ";" in self.lines[0] and "," not in self.lines[0]
        self.number = 0

    def peek(self) -> str:
        line = self.lines[self.number] if self.number < len(self.lines) else ""
        return line.replace(",", ".").replace(";", ",") if self.semicolons else line

    def next(self) -> str:
        line = self.peek()
        self.number += 1
        return line

    def fields(self) -> list[str]:
        return [field.strip() for field in self.next().split(",")]

    def number_of_line(self, default: float) -> float:
        return _number(self.next(), default, f"line {self.number}")


def _channel(lines: _Lines, number: int) -> str:
    """n,name,phase,circuit,unit,a,b,skew,min,max,primary,secondary,P|S with numbers in all places
    of numbers.
    """
    fields = lines.fields()
    where = f"line {lines.number}"
    while len(fields) > _FIELDS and not fields[-1]:
        fields.pop()
    if len(fields) > _FIELDS or len(fields) < 6:
        raise ValueError(
            f"{where} must have the {_FIELDS} fields of an analog channel, found {len(fields)}: a "
            "comma in a name or number?"
        )
    fields += [""] * (_FIELDS - len(fields))
    defaults = (None, 0.0, 0.0, -1e300, 1e300, 1.0, 1.0)
    numbers = [
        _number(text, default, where) for text, default in zip(fields[5:12], defaults, strict=True)
    ]
    require_in_range("skew", numbers[2], f"{where}: the skew of a channel", ValueError)
    side = "S" if fields[12].upper().startswith("S") else "P"
    return ",".join([str(number), *fields[1:5], *map(repr, numbers), side])


def _rates(lines: _Lines) -> list[tuple[float, int]]:
    """(samples per second, number of the last sample at this rate); a rate of 0 where each sample
    has its time.
    """
    count = _count(lines.number_of_line(0.0), f"line {lines.number}")
    if count > len(lines.lines):
        raise ValueError(
            f"line {lines.number} announces {count} rates, more than there are lines; correct it"
        )
    if count == 0 and not re.fullmatch(r"[\d.]*\s*,\s*\d*", lines.peek()):
        return [(0.0, 0)]
    rates = []
    for _ in range(max(count, 1)):
        rate, *last = lines.fields()
        where = f"line {lines.number}"
        per_second = _number(rate, 0.0, where)
        if per_second:
            require_in_range(
                "sampling_hz", per_second, f"{where}: the rate of sampling", ValueError
            )
        rates.append((per_second, _count(_number(last[0] if last else "", 0.0, where), where)))
    return rates if count else [(0.0, rates[0][1])]


def _count(number: float, where: str) -> int:
    if not 0 <= number < 1e12:
        raise ValueError(f"{where} must hold a count, found {number:g}")
    return int(number)


def _fraction(lines: _Lines) -> int:
    """Digits behind the seconds, which say whether times of samples are micro- or nanoseconds; a
    line that is no time stays.
    """
    if "/" not in lines.peek() and ":" not in lines.peek() and lines.peek():
        return 0
    found = _TIME.search(lines.next())
    return len(found[1] or "") if found else 0


def _rows(data: bytes, kind: str, analog: int, states: int) -> int:
    if kind == "ASCII":
        if b"\0" in data.strip(b"\x1a\0 \r\n"):
            raise ValueError(
                "the configuration says ASCII and the samples are binary, write BINARY if they are "
                "so"
            )
        return sum(bool(line.strip(b"\x1a\0 \t,")) for line in data.splitlines())
    if kind not in _WIDTH:
        raise ValueError(
            f"the samples must be {', '.join(('ASCII', *_WIDTH))}, found {kind[:20]!r}"
        )
    return len(data) // (8 + _WIDTH[kind] * analog + 2 * -(-states // 16))


def _numbers(data: bytes, kind: str, analog: int, states: int, rows: int) -> np.ndarray:
    """(rows,) the number that stands beside each sample; 0 where it is none."""
    if kind != "ASCII":
        width = 8 + _WIDTH[kind] * analog + 2 * -(-states // 16)
        whole = np.frombuffer(data, np.uint8, rows * width).reshape(rows, width)
        return np.ascontiguousarray(whole[:, :4]).view("<u4").ravel().astype(float)
    cells = [line.strip(b"\x1a\0 \t").split(b",")[0].strip() for line in data.splitlines()]
    return np.array([float(cell) if cell.isdigit() else 0.0 for cell in cells if cell])


def _of_whole_rows(
    data: bytes, numbers: np.ndarray, announced: int, fewest: int, most: int
) -> np.ndarray:
    """The numbers of the samples, -1 behind those announced where a row does not have the cells of
    the configuration.

    Raises ValueError where an announced one has not.
    """
    lines = [line.strip(b"\x1a\0 \t") for line in data.splitlines()]
    lines = [line for line in lines if line.split(b",")[0].strip()]
    numbers = numbers.copy()
    for row, line in enumerate(lines):
        cells = line.count(b",") + 1
        filled = line.rstrip(b", \t").count(b",") + 1
        if fewest <= cells and filled <= most:
            continue
        if row < announced:
            wanted = f"{fewest}" if fewest == most else f"{fewest} to {most}"
            raise ValueError(
                f"row {row + 1} of the samples must have {wanted} cells, number, time and the "
                "channels of the configuration; "
                f"found {cells if cells < fewest else filled}: is it cut off, or the configuration "
                "of another record?"
            )
        numbers[row] = -1.0
    return numbers


def _behind(numbers: np.ndarray, announced: int) -> tuple[int, int]:
    """How many samples behind those announced continue them, and how many do not: the numbers
    beside them go on by one step.

    Zeros to the end fill a block of the medium and are no samples.
    """
    if len(numbers) == announced or min(len(numbers), announced) < 3:
        return 0, 0
    goes_on = np.diff(numbers) == np.median(np.diff(numbers[:announced]))
    if goes_on[: announced - 1].mean() < 0.5:
        raise ValueError(
            f"there are {len(numbers)} rows where {announced} are announced, and the numbers "
            "beside them jump: the samples do "
            "not have the channels of this configuration, or belong to another"
        )
    behind = numbers[announced:]
    jumps = np.flatnonzero(~goes_on[announced - 1 :])
    beyond = int(jumps[0]) if len(jumps) else len(behind)
    filled = np.flatnonzero(behind[beyond:])
    return beyond, int(filled[-1]) + 1 if len(filled) else 0


def _number(text: str, default: float | None, where: str) -> float:
    text = text.strip()
    if not text and default is not None:
        return default
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{where} must be a number, found {text[:40]!r}") from None
