"""Touchstone two-ports (.s2p, .y2p, .z2p) that hold a dq admittance or impedance: port 1 is d, port
2 is q.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError, near
from ibrid.measurement.conventions.conversions import Quantity
from ibrid.measurement.conventions.header import HEADER_KEYS, POINT_KEYS, number_of, read_keys
from ibrid.measurement.formats.bundle import stem_of, suffix_of
from ibrid.measurement.formats.files import read_lines, write_atomically
from ibrid.measurement.formats.response import Response, sidecar_keys
from ibrid.measurement.sweeps.sweep import Sweep

#: How their names end.
TOUCHSTONE = (".s2p", ".y2p", ".z2p")
_HZ = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "GHZ": 1e9}
_FORMATS = ("RI", "MA", "DB")
_PARAMETERS = ("Y", "Z", "S", "G", "H")
#: What an option line says, each once: the words for it.
_OPTIONS = {
    "unit of frequency": tuple(_HZ),
    "parameter": _PARAMETERS,
    "format": _FORMATS,
    "resistance": ("R",),
}
#: Beginning of the remark that S was converted to Y.
SCATTERING = "S-parameters"
#: Degrees beyond which an angle is a mistake: of 1e16 the sine is chance.
_LARGEST_ANGLE = 1e6


@dataclass(frozen=True)
class _Options:
    hz: float = 1e9
    parameter: str = "S"
    form: str = "MA"
    ohm: float = 50.0


def touchstone_response(path: Path) -> Response:
    """One operating point of a Touchstone 1 two-port.

    Option line `# Hz Y RI R 50`: unit Hz, kHz, MHz, GHz; parameter Y, Z or S; format RI, MA (angle
    in degrees) or DB; rows of f 11 21 12 22, in this order. As the format prescribes, Y and Z are
    normalised to R: an admittance is the number divided by R, in S; a file in per unit says `R 1`.
    p, q, v, op and header keys stand in comments `! p: 1`, in `<path>.meta`; the later win. Without
    `unit` the numbers are S and ohm (the bases must then be given); with R 1 the file does not say
    its unit, and `read_sweep` takes per unit.

    Raises SweepError naming file and line.
    """
    lines = read_lines(path)
    comments, body = [], []
    for number, line in enumerate(lines, 1):
        text, mark, comment = line.partition("!")
        if mark:
            comments.append((number, comment))
        if text.strip():
            body.append((number, text.strip()))
    inside, notes = read_keys(comments, str(path), HEADER_KEYS + POINT_KEYS)
    beside, more = sidecar_keys(path)
    options = _options(body, path)
    frequency, matrix = _table(body, options, path)
    letter = options.parameter.replace("S", "Y")
    told = {} if options.ohm == 1 else {"unit": "S" if letter == "Y" else "ohm"}
    if options.parameter == "S":
        if suffix_of(path) != ".s2p":
            raise SweepError(f"{path} must say Y or Z in its option line; found S, call it .s2p.")
        matrix = _admittance(matrix, options.ohm, path)
        told["current"] = "in"
        words = f"{SCATTERING} at {options.ohm:g} ohm became admittances, current into the ports"
        notes = (*notes, words)
    told |= inside | beside
    return Response(frequency, matrix, Quantity(letter), told, notes + more, stem_of(path))


def _admittance(scattering: np.ndarray, ohm: float, path: Path) -> np.ndarray:
    """Y = (1 + S)^-1 (1 - S) / R in siemens, (K, 2, 2); currents flow into the ports."""
    one = np.eye(2)
    try:
        return np.linalg.solve(one + scattering, one - scattering) / ohm
    except np.linalg.LinAlgError:
        raise SweepError(
            f"{path}: 1 + S must be invertible; found a short circuit, export Y or Z."
        ) from None


@takes_kinds
def write_touchstone(sweep: Sweep, path: str | Path, op: str) -> None:
    """Write one operating point as Touchstone Y in per unit (`# Hz Y RI R 1`); p, q, v and f0 stand
    in comments.

    Raises OperatingPointError without that point, SweepError when the file cannot be written.
    """
    point = sweep.point(op)
    keys = {
        "op": op,
        "p": point.op.p,
        "q": point.op.q,
        "v": point.op.v,
        "f0_hz": sweep.f0_hz,
        "unit": "pu",
    }
    keys |= {"current": "out", "q_axis": "leads", "power_node": sweep.power_node}
    keys |= {"s_base_va": sweep.s_base_va, "v_base_v": sweep.v_base_v}
    lines = [
        "! dq admittance, per unit, current out of the inverter, q leads; port 1: d, port 2: q"
    ]
    lines += [f"! {key}: {value}" for key, value in keys.items() if value is not None]
    lines.append("# Hz Y RI R 1")
    for frequency, matrix in zip(point.frequency, point.admittance, strict=True):
        entries = (matrix[0, 0], matrix[1, 0], matrix[0, 1], matrix[1, 1])
        numbers = [frequency, *(part for entry in entries for part in (entry.real, entry.imag))]
        lines.append(" ".join(repr(float(number)) for number in numbers))
    write_atomically(Path(path), "\n".join(lines) + "\n")


def _options(body: list[tuple[int, str]], path: Path) -> _Options:
    """The option line; a second one is ignored, as the format says."""
    for number, text in body:
        if text.startswith("["):
            raise SweepError(
                f"{path} line {number}: Touchstone must be version 1; found version 2, export "
                "version 1."
            )
        if text.startswith("#"):
            return _parsed_options(text[1:].upper().split(), f"{path} line {number}")
    raise SweepError(f"{path} must have an option line, for instance '# Hz Y RI R 1'; found none.")


def _parsed_options(words: list[str], where: str) -> _Options:
    options = _Options()
    kinds = {word: kind for kind, known in _OPTIONS.items() for word in known}
    said: dict[str, str] = {}
    rest = iter(words)
    for word in rest:
        if word not in kinds:
            raise SweepError(
                f"{where}: {word[:40]} is not a Touchstone option; {near(word, kinds)}"
            )
        kind = kinds[word]
        if kind in said:
            raise SweepError(
                f"{where}: the {kind} must be said once; found {said[kind]} and {word}, leave one "
                "out."
            )
        said[kind] = word
        if word in _HZ:
            options = replace(options, hz=_HZ[word])
        elif word in _PARAMETERS:
            options = replace(options, parameter=word)
        elif word in _FORMATS:
            options = replace(options, form=word)
        else:
            options = replace(options, ohm=number_of(next(rest, ""), f"{where}: R"))
    if options.parameter not in "YZS":
        raise SweepError(
            f"{where}: parameter must be Y, Z or S; found {options.parameter}, export admittances."
        )
    if options.ohm <= 0:
        raise SweepError(f"{where}: R must be positive; found {options.ohm:g}.")
    return options


def _table(
    body: list[tuple[int, str]], options: _Options, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and matrices in S or ohm; a row of a two-port is nine numbers, in 11 21 12
    22 order.
    """
    rows = []
    for number, text in body:
        if text.startswith("#"):
            continue
        words = re.split(r"[\s,]+", text.strip(", "))
        if len(words) != 9:
            raise SweepError(
                f"{path} line {number} must hold nine numbers (frequency, then 11 21 12 22); found "
                f"{len(words)}, "
                "is it a two-port without noise data?"
            )
        row = [
            number_of(word, f"{path} line {number}: value {k}") for k, word in enumerate(words, 1)
        ]
        angle = 0.0 if options.form == "RI" else max(row[2::2], key=abs)
        if abs(angle) > _LARGEST_ANGLE:
            raise SweepError(
                f"{path} line {number}: an angle must be within {_LARGEST_ANGLE:g} degrees; found "
                f"{angle:g}, is it RI?"
            )
        rows.append(row)
    if not rows:
        raise SweepError(f"{path} must hold rows of numbers; found none.")
    numbers = np.array(rows)
    first, second = numbers[:, 1::2], numbers[:, 2::2]
    with np.errstate(all="ignore"):
        if options.form == "RI":
            entries = first + 1j * second
        else:
            size = 10 ** (first / 20) if options.form == "DB" else first
            entries = size * np.exp(1j * np.deg2rad(second))
        entries *= {"Y": 1 / options.ohm, "Z": options.ohm}.get(options.parameter, 1.0)
        return numbers[:, 0] * options.hz, np.swapaxes(entries.reshape(-1, 2, 2), 1, 2)
