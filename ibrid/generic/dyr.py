"""Files of dynamic data (.dyr, PSS/E): read with names for what they hold, and written.

Law: a record is `bus 'MODEL' id numbers /`, over several lines; flags come before constants, each
in the order that the block declares.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.generic.block import LawBlock

#: Models that NERC's list of acceptable models prohibits -> what to take in their place.
PROHIBITED = {"REECB1": "REECA1 or REECD1", "GENCLS": "a model of the machine"}
_RECORD = re.compile(r"\s*(\d+)\s*,?\s*'([^']+)'\s*,?\s*'?(\w+)'?\s*,?\s*(.*)", re.DOTALL)


@dataclass(frozen=True)
class DyrRecord:
    """One model at one generator. `numbers` : as they stand, without bus, model and id."""

    bus: int
    model: str
    id: str
    numbers: tuple[float, ...]


def read_dyr(path: str | Path) -> tuple[DyrRecord, ...]:
    """The records of a file.

    Raises IbridError: it cannot be read, a record is not ended by a slash or holds what is no
    number.
    """
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError as reason:
        raise IbridError(f"{path} cannot be read: {reason.strerror}") from reason
    lines = (line.split("//")[0] for line in text.splitlines())
    *pieces, last = "\n".join(line for line in lines if not line.startswith("@")).split("/")
    if last.strip() and _RECORD.match(last):
        raise IbridError(f"{path}: the last record must end with a slash; add it")
    return tuple(_record(piece, str(path)) for piece in pieces if piece.strip() and "'" in piece)


def _record(text: str, where: str) -> DyrRecord:
    matched = _RECORD.match(text)
    if matched is None:
        raise IbridError(
            f"{where}: a record is written bus 'MODEL' id numbers /; found {text.strip()[:40]!r}"
        )
    bus, model, machine, rest = matched.groups()
    numbers = []
    for word in re.split(r"[\s,]+", rest.strip()):
        try:
            numbers.append(float(word.strip("'") or 0.0))
        except ValueError:
            numbers.append(0.0) if word.startswith("'") else _refuse(where, bus, model, word)
    return DyrRecord(int(bus), model.strip(), machine, tuple(numbers))


def _refuse(where: str, bus: str, model: str, word: str) -> None:
    raise IbridError(
        f"{where}: the record of {model} at bus {bus} must hold numbers; found {word[:20]!r}"
    )


def values_from(
    records: Sequence[DyrRecord], blocks: Sequence[LawBlock], bus: int | None = None
) -> tuple[dict[str, float], int, str]:
    """Values of all blocks by name, and the bus and id of their generator.

    Raises IbridError: a block is missing, prohibited or has another count of numbers, or several
    generators have it and no bus is said.
    """
    values = dict[str, float]()
    at, machine = 0, ""
    for block in blocks:
        own = [record for record in records if record.model == block.dyr]
        own = [record for record in own if bus in (None, record.bus)]
        if not own:
            present = ", ".join(sorted({record.model for record in records})) or "nothing"
            wrong = [name for name in PROHIBITED if name in present]
            advice = f"; {wrong[0]} is prohibited by NERC, convert it to {PROHIBITED[wrong[0]]}"
            raise IbridError(
                f"the file must hold {block.dyr}; found {present}{advice if wrong else ''}"
            )
        if len({(record.bus, record.id) for record in own}) > 1:
            buses = ", ".join(str(record.bus) for record in own)
            raise IbridError(f"{block.dyr} stands at buses {buses}; say which one: --bus")
        record = own[0]
        numbers = record.numbers[len(block.places) :]
        if len(numbers) != len(block.names):
            raise IbridError(
                f"the record of {block.dyr} at bus {record.bus} must hold "
                f"{len(block.places) + len(block.names)} numbers; found {len(record.numbers)}"
            )
        values |= dict(zip(block.names, numbers, strict=True))
        at, machine = record.bus, record.id
    return values, at, machine


def dyr_text(
    blocks: Sequence[LawBlock], values: Mapping[str, float], bus: int, machine: str
) -> str:
    """The records of one generator."""
    records = []
    for block in blocks:
        places = ["0"] * len(block.places)
        flags = [f"{round(values[flag.name])}" for flag in block.flags]
        numbers = [f"{values[constant.name]:.6g}" for constant in block.constants]
        lines = [f"{bus} '{block.dyr}' {machine}", " ".join([*places, *flags])]
        lines += [" ".join(numbers[k : k + 8]) for k in range(0, len(numbers), 8)]
        records.append("\n  ".join(line for line in lines if line) + " /")
    return "\n".join(records) + "\n"


def range_warnings(blocks: Sequence[LawBlock], values: Mapping[str, float]) -> tuple[str, ...]:
    """Sentences about constants outside of what is usual, and bounds that cross."""
    said = []
    for block in blocks:
        for constant in block.constants:
            value = values[constant.name]
            off = value in (0.0, constant.typical)
            if not off and not constant.low <= value <= constant.high:
                said.append(
                    f"{block.name} {constant.name} = {value:g} is outside of {constant.low:g} to "
                    f"{constant.high:g}"
                )
    for low, high in (("QMin", "QMax"), ("VMIN", "VMAX"), ("Zerox", "Brkpt"), ("Vdip", "Vup")):
        if low in values and high in values and values[low] >= values[high]:
            said.append(f"{low} = {values[low]:g} must be below {high} = {values[high]:g}")
    return tuple(said)
