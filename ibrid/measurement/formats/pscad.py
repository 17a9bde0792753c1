"""Text that PSCAD frequency-scan tools write: complex matrices in rows (Z-tool), or columns
Zdut_dq_11_re (IMTB).

Formats seen in github.com/Electa-Git/Z-tool (frequency_sweep results, numpy.savetxt of complex
numbers) and in github.com/Energinet-SimTools/IMTB (IM_Zdq_MIMO_*.csv).
"""

import re
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.conversions import Quantity
from ibrid.measurement.conventions.header import number_of
from ibrid.measurement.formats.csv_columns import ENTRIES
from ibrid.measurement.formats.files import first_line, read_lines
from ibrid.measurement.formats.response import Response, sidecar_keys

_IMTB = tuple(
    f"Zdut_dq_{entry}_{part}" for entry in ("11", "12", "21", "22") for part in ("re", "im")
)


def pscad_response(path: Path, *, surely: bool = False) -> Response | None:
    """What Z-tool or IMTB wrote, None for other files; surely : others may begin with f too, but
    not with a terminal's d next.
    """
    first = first_line(path)
    names = first.split()
    if "Zdut_dq_11_re" in first or "Zdut_ab_11_re" in first:
        return _imtb_response(path)
    terminal = names[1:2] in (["dd"], ["pp"]) or " ".join(names[1:2]).endswith("_d")
    return _ztool_response(path) if names[:1] == ["f"] and (terminal or not surely) else None


def _ztool_response(path: Path) -> Response:
    """One AC terminal from a Z-tool result `...#Y_AC#PCC-1#.txt`.

    First line: f and the names of the rows and columns (PCC-1_d, PCC-1_q); or, from its
    conversions, dd dq qd qq or pp pn np nn. Then per line the frequency in the dq frame and four
    complex numbers, row by row, written (1.0+2.0j), 1.0+2.0i or alike. The tool gives kA/kV with
    the current into the block and, as PSCAD, the q axis lagging; so unit: S, current: in and
    q_axis: lags (leads under dd dq qd qq) are meant unless `<path>.meta` says otherwise.

    Raises SweepError naming file and line; also for DC, AC/DC and multi-terminal matrices.
    """
    lines = [(number, line) for number, line in enumerate(read_lines(path), 1) if line.strip()]
    frame = _frame(lines[0][1].split()[1:], path)
    rows = [_complex_row(number, line, path) for number, line in lines[1:]]
    if not rows:
        raise SweepError(f"{path} must hold rows of complex numbers; found only the names.")
    numbers = np.array(rows)
    beside, notes = sidecar_keys(path)
    sequence = frame == "sequence"
    told = {"unit": "S", "current": "in", **({} if sequence else {"q_axis": frame}), **beside}
    name, matrix = path.stem.split("#")[0] or "op", numbers[:, 1:].reshape(-1, 2, 2)
    return Response(np.real(numbers[:, 0]), matrix, Quantity("Y", sequence), told, notes, name)


def _imtb_response(path: Path) -> Response:
    """The device's side of an IMTB result IM_Zdq_MIMO_*.csv: columns f (dq frame), Zdut_dq_11_re ..
    Zdut_dq_22_im.

    The q axis leads; unit: ohm. Which way the current counts depends on how the block was placed,
    so it must be said.

    Raises SweepError naming file and line.
    """
    lines = [
        (number, line.split(",")) for number, line in enumerate(read_lines(path), 1) if line.strip()
    ]
    names = [name.strip() for name in lines[0][1]]
    missing = [name for name in _IMTB if name not in names]
    if missing:
        raise SweepError(
            f"{path} line {lines[0][0]}: column {missing[0]} is missing; is it an IM_Zdq_MIMO file?"
        )
    beside, notes = sidecar_keys(path)
    places = [0, *(names.index(name) for name in _IMTB)]
    rows = []
    for number, fields in lines[1:]:
        if len(fields) != len(names):
            raise SweepError(
                f"{path} line {number} must have {len(names)} values; found {len(fields)}."
            )
        rows.append(
            [number_of(fields[place], f"{path} line {number}: {names[place]}") for place in places]
        )
    if not rows:
        raise SweepError(f"{path} must hold rows of numbers; found only the column names.")
    numbers = np.array(rows)
    matrix = (numbers[:, 1::2] + 1j * numbers[:, 2::2]).reshape(-1, 2, 2)
    told = {"unit": "ohm", "current": None, "q_axis": "leads", **beside}
    return Response(numbers[:, 0], matrix, Quantity("Z"), told, notes, path.stem)


def _frame(names: list[str], path: Path) -> str:
    """What the names of the first line say: "lags" (the tool's own output), "leads" or
    "sequence".
    """
    if tuple(names) == ENTRIES["dq"]:
        return "leads"
    if tuple(names) == ENTRIES["pn"]:
        return "sequence"
    if len(names) == 2 and names[0].endswith("_d") and names[1].endswith("_q"):
        return "lags"
    raise SweepError(
        f"{path} line 1 must name one AC terminal, f and then its _d and _q; "
        f"found {', '.join(names)[:80] or 'nothing'}, scan the inverter's terminal alone."
    )


def _complex_row(number: int, line: str, path: Path) -> list[complex]:
    words = [re.sub(r"\s+", "", word) for word in re.findall(r"\([^()]*\)|[^\s()]+", line)]
    if len(words) != 5:
        raise SweepError(
            f"{path} line {number} must hold the frequency and four complex numbers; found "
            f"{len(words)}."
        )
    values = [_complex(word, f"{path} line {number}: value {k}") for k, word in enumerate(words, 1)]
    if values[0].imag:
        raise SweepError(
            f"{path} line {number}: the frequency must be real; found {words[0][:60]}."
        )
    return values


def _complex(word: str, what: str) -> complex:
    text = word.strip("()").replace("*", "").replace("i", "j").replace("I", "j").replace("+-", "-")
    try:
        value = complex(text)
    except ValueError:
        value = complex("nan")
    if not np.isfinite(value) or "_" in text:
        raise SweepError(
            f"{what} must be a finite complex number such as (1.0+2.0j); found {word[:60]!r}."
        )
    return value
