"""What the comments of a recording say in words of their own: bases and nominal frequency with
their units, ratios of instrument transformers.
"""

import re
from collections.abc import Container, Sequence
from dataclasses import dataclass

from ibrid.measurement.importing.doubts.other_base import other_base
from ibrid.measurement.importing.doubts.transformer_ratio import (
    TransformerDoubt,
    primary_said,
    transformer_doubts,
)
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.timed.probes import volts_per_ampere
from ibrid.measurement.importing.told import (
    base_in_words,
    current_in_words,
    doubts_beside,
    rating_beside,
    told_beside,
)

#: Keys of a header, and what their numbers measure.
_DIMENSIONS = {"s_base_va": "power", "v_base_v": "voltage", "f0_hz": "frequency"}
#: A line that is one number with its unit.
_ONE_NUMBER = re.compile(r"[^:=]+[:=]\s*[-+.,\deE]+?\s*[A-Za-zµ]+\s*")


@dataclass(frozen=True)
class RecordingComments:
    """keys : header keys that words say (VA, V, Hz). lines : with their numbers, those that
    are keys and notes as they stand. remarks : what was read so, and what is doubted.
    transformers : what is told of instrument transformers. probes : V per A of those of currents.
    """

    keys: dict[str, object]
    lines: list[tuple[int, str]]
    remarks: tuple[str, ...]
    transformers: tuple[TransformerDoubt, ...]
    probes: tuple[float, ...]


def read_comments(
    tables: Sequence[ForeignTable], base: tuple[float, float] | None = None
) -> RecordingComments:
    """Read the comments of tables. base : VA and V that the user says."""
    comments = [line for table in tables for line in table.comments]
    texts = [text for _, text in comments]
    notes = [note.lstrip("#% ") for table in tables for note in table.notes]
    texts += [note for note in notes if note not in texts]
    told = told_beside("", texts)
    keys: dict[str, object] = {}
    remarks = []
    for key, dimension in _DIMENSIONS.items():
        entry = told.get(key)
        if isinstance(entry, tuple) and entry[1] == dimension:
            value, _, name, unit = entry
            keys[key] = value
            if base is None or key == "f0_hz":
                remarks.append(f"{key} = {value:g}, from {name} in {unit}")
    if (way := current_in_words(texts)) and told["current"] == way[0]:
        keys["current"] = way[0]
        remarks.append(f"current: {way[0]}, as its words say: {way[1][:80]!r}")
    if base and (file := other_base(rating_beside(texts) | told, base)):
        remarks.append(f"base: {base_in_words(*base)} as said, while its words state {file}")
    plain = [line for line in comments if not _is_one_of(line[1], keys)]
    doubts = [doubt for doubt in doubts_beside("", texts) if not re.match(r"[PQV]\b", doubt)]
    transformers = transformer_doubts(texts)
    primary = primary_said(texts)
    if primary and not transformers:
        remarks.append(f"values of the primary side: {primary.strip()[:80]!r}")
    probes = volts_per_ampere(texts)
    return RecordingComments(keys, plain, (*remarks, *doubts), transformers, probes)


def _is_one_of(comment: str, keys: Container[str]) -> bool:
    """Whether a comment is just the number of one of the keys, with its unit."""
    if not _ONE_NUMBER.fullmatch(comment):
        return False
    return any(key in keys for key in told_beside("", [comment]))
