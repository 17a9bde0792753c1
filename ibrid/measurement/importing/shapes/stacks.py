"""Matrices at each frequency in one array: the names of their parts, and those with further ports
as entries that `more_ports` reads.
"""

import re
from collections.abc import Mapping

import numpy as np

from ibrid.measurement.importing.column_words import meaning_of, without_unit

#: Ports of a matrix that is told apart from a table of numbers.
MOST_PORTS = 8
#: Names of arrays that hold a part of a matrix: Y_re, Zphase; re_Y, abs(Z).
_PART_LAST = re.compile(r"(?P<matrix>.+?)_?(?P<part>[A-Za-z]+)")
_PART_FIRST = re.compile(r"(?P<part>[a-zA-Z]+?)[_(]?(?P<matrix>[YZ]\w*)\)?")
#: Parts of the largest entry within which those of three phases are alike.
_ALIKE = 0.02
_TURN = np.exp(-2j * np.pi / 3)


def matrix_and_part(name: str) -> tuple[str, str]:
    """The name of a matrix, and the part of it that an array of the name Y_re or imag_Z holds, with
    an underscore before it; "" where it holds all.
    """
    for pattern in (_PART_LAST, _PART_FIRST):
        words = pattern.fullmatch(name)
        if words and meaning_of(words["part"]).role in ("re", "im", "mag", "phase"):
            return words["matrix"], f"_{words['part']}"
    return name, ""


def ports_of(shape: tuple[int, ...]) -> int:
    """How many ports the matrices of a stack have, where they are more than two; else 0."""
    first, middle, last = shape
    if first == middle and 2 < first <= MOST_PORTS:
        return first
    return middle if middle == last and 2 < middle <= MOST_PORTS else 0


def with_ports(
    arrays: Mapping[str, np.ndarray], length: int
) -> tuple[dict[str, np.ndarray], set[str], tuple[str, ...]]:
    """Columns of stacks with further ports, the names of the arrays that they are made of, and what
    was assumed. Three phases that are alike leave their positive sequence.
    """
    columns: dict[str, np.ndarray] = {}
    used: set[str] = set()
    remarks = []
    for base, (whole, names) in _whole_stacks(arrays, length).items():
        bare, unit = without_unit(base.rsplit(".", 1)[-1])
        letter, unit = meaning_of(f"{bare}(1,1)").letter, f" [{unit}]" if unit else ""
        if not letter:
            continue
        used |= names
        first, last = f"{letter}{'{}'}_re{unit}", f"{letter}{'{}'}_im{unit}"
        ports = whole.shape[1]
        if _is_of_phases(whole):
            own = whole[:, 0, :] @ [1, _TURN, _TURN.conj()]
            entries = {"pos": own}
            remarks.append(
                f"{bare} is 3x3 of three phases that are alike: its positive sequence is taken, "
                "what the zero sequence answers is lost"
            )
        else:
            called = ["d", "q", *(f"x{k}" for k in range(3, ports + 1))]
            entries = {
                called[row] + called[column]: whole[:, row, column]
                for row, column in np.ndindex(ports, ports)
            }
            remarks.append(
                f"{bare} is {ports}x{ports} at each frequency: its first two rows and columns are "
                "taken as d and q, the others as further ports; if they stand in another order, "
                "save the 2x2 block of d and q"
            )
        for entry, value in entries.items():
            columns[first.format(entry)] = np.real(value)
            columns[last.format(entry)] = np.imag(value)
    return columns, used, tuple(remarks)


def _whole_stacks(
    arrays: Mapping[str, np.ndarray], length: int
) -> dict[str, tuple[np.ndarray, set[str]]]:
    """Complex (K, n, n) by the name of the matrix, and the arrays that they are made of."""
    parts: dict[str, dict[str, tuple[str, np.ndarray]]] = {}
    for name, value in arrays.items():
        shape = value.shape
        if value.ndim != 3 or not ports_of(shape) or shape[0] == shape[1] == shape[2]:
            continue
        base, part = matrix_and_part(name)
        first = value if shape[1] == shape[2] else np.moveaxis(value, -1, 0)
        if len(first) == length:
            parts.setdefault(base, {})[meaning_of(part).role] = name, first
    whole = {}
    for base, held in parts.items():
        names = {name for name, _ in held.values()}
        if held.keys() == {"re", "im"} and held["re"][1].shape == held["im"][1].shape:
            whole[base] = held["re"][1] + 1j * held["im"][1], names
        elif held.keys() == {""} and held[""][1].dtype.kind == "c":
            whole[base] = held[""][1], names
    return whole


def _is_of_phases(whole: np.ndarray) -> bool:
    """Whether turning a, b and c leaves a 3x3 matrix as it is."""
    turned = np.roll(whole, (1, 1), axis=(1, 2))
    return whole.shape[1] == 3 and np.abs(turned - whole).max() < _ALIKE * np.abs(whole).max()
