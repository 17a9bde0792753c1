"""Files of dynamic data (.dyr, PSS/E): read with names for what they hold, and written.

Law: a record is `bus 'MODEL' id numbers /`, over several lines; flags come before constants, each
in the order that the block declares.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path

from ibrid.errors import IbridError, some
from ibrid.foreign_data import text_in
from ibrid.generic.block import LawBlock

#: Models that NERC's list of acceptable models prohibits -> what to take in their place.
PROHIBITED = {"REECB1": "REECA1 or REECD1", "GENCLS": "a model of the machine"}
# possessive (*+): blanks that several places may take would cost the cube of their number
_RECORD = re.compile(
    r"\s*+(\d{1,9})\s*+,?\s*+'([^']+)'\s*+,?\s*+'?\s*+(\w+)\s*+'?\s*+,?\s*+(.*)", re.DOTALL
)


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
        text = text_in(Path(path))
    except OSError as reason:
        raise IbridError(f"{path} cannot be read ({reason.strerror}); give a .dyr file") from None
    except ValueError as reason:
        raise IbridError(f"{path} is no .dyr file: {reason}; give one of PSS/E") from None
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
    words = re.split(r"[\s,]+", rest.strip())
    numbers = [_number(word, f"{where}: the record of {model} at bus {bus}") for word in words]
    return DyrRecord(int(bus), model.strip(), machine, tuple(numbers))


def _number(word: str, where: str) -> float:
    """A number of a record; 0 for a quoted name, such as that of a bus elsewhere."""
    if word.startswith("'"):
        return 0.0
    try:
        number = float("" if "_" in word else word)
    except ValueError:
        number = nan
    if not isfinite(number):
        raise IbridError(f"{where} must hold finite numbers; found {word[:20]!r}, correct it")
    return number


def values_from(
    records: Sequence[DyrRecord],
    blocks: Sequence[LawBlock],
    bus: int | None = None,
    machine: str | None = None,
) -> tuple[dict[str, float], int, str]:
    """Values of all blocks by name, and the bus and id of their generator.

    Raises IbridError: a block is missing, prohibited, has another count of numbers or a flag that
    is none; several generators have it and neither bus nor id says which, its blocks are of
    different ones, or one generator has it twice.
    """
    values = dict[str, float]()
    generators = set[tuple[int, str]]()
    for block in blocks:
        own = [record for record in records if record.model == block.dyr]
        own = [record for record in own if bus in (None, record.bus)]
        own = [record for record in own if machine in (None, record.id)]
        if not own:
            places = sorted({f"{one.model} at bus {one.bus}, id {one.id}" for one in records})
            wanted = "" if bus is None else f" at bus {bus}"
            wanted += "" if machine is None else f" with id {machine}"
            present = {record.model for record in records}
            advice = [
                f"; {name} is prohibited by NERC, convert it to {PROHIBITED[name]}"
                for name in PROHIBITED
                if name in present
            ]
            raise IbridError(
                f"the file must hold {block.dyr}{wanted}; found {some(places) or 'nothing'}"
                f"{''.join(advice[:1])}"
            )
        if len(own) > 1:
            places = [f"bus {record.bus}, id {record.id}" for record in own]
            say = "say which one: --bus, --id"
            say = say if len({*places}) > 1 else "leave out all but one"
            raise IbridError(f"{block.dyr} stands at {some(places)}; {say}")
        record = own[0]
        numbers = record.numbers[len(block.places) :]
        if len(numbers) != len(block.names):
            raise IbridError(
                f"the record of {block.dyr} at bus {record.bus} must hold "
                f"{len(block.places) + len(block.names)} numbers; found {len(record.numbers)}"
            )
        own_values = dict(zip(block.names, numbers, strict=True))
        _require_choices(block, own_values)
        values |= own_values
        generators.add((record.bus, record.id))
    if len(generators) > 1:
        stands = " and ".join(f"bus {at}, id {its_id}" for at, its_id in sorted(generators))
        raise IbridError(
            f"{', '.join(block.dyr for block in blocks)} must be of one generator; found {stands}, "
            "say which one: --bus"
        )
    ((at, its_id),) = generators
    return values, at, its_id


def _require_choices(block: LawBlock, values: Mapping[str, float]) -> None:
    """Raise IbridError for a flag that is none of its choices."""
    for flag in block.flags:
        if values[flag.name] not in flag.choices:
            choices = " or ".join(map(str, flag.choices))
            raise IbridError(
                f"{flag.name} of {block.dyr} must be {choices}; found {values[flag.name]:g}, "
                "correct it, or see whether a number is missing ahead of it"
            )


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
