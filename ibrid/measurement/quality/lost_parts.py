"""Entries whose imaginary, or real, parts are zero in every row: a column that was lost.

Law: the response of a causal device that is real at all frequencies is the same at all of them
(Kramers and Kronig). Lossless reactances alone, whose Hermitian part is zero, have it otherwise:
an inductance seen in dq is imaginary in dd and real in dq.
"""

from collections.abc import Iterator

import numpy as np

from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep

#: Fewest rows that show it, and the least change over frequency, as a part of the largest value.
_ROWS, _CHANGE = 4, 1e-3
#: Parts of the largest value below which an entry's part is zero, and the Hermitian part of all:
#: what rounding leaves of zero in an inverse.
_ZERO, _LOSSLESS = 1e-10, 1e-9


def lost_parts(sweep: Sweep) -> Iterator[str]:
    """A sentence for the imaginary parts that are all zero, one for the real ones.

    Seen are the admittances, and where they have none the impedances that a file may hold.
    """
    for part in ("imaginary", "real"):
        for letter in ("Y", "Z"):
            lost = {
                point.op.name: names
                for point in sweep.points
                if (names := _lost(point, part, letter))
            }
            if lost:
                yield _sentence(lost, part, letter, len(sweep.points))
                break


def _sentence(lost: dict[str, tuple[str, ...]], part: str, letter: str, points: int) -> str:
    entries = [name for name in ENTRIES if any(name in names for names in lost.values())]
    named = ", ".join(f"{letter}{name}" for name in entries)
    where = "" if len(lost) == points else f" at {', '.join(list(lost)[:3])}"
    other = "real" if part == "imaginary" else "imaginary"
    first = f"{letter}{entries[0]}"
    return (
        f"the {part} parts of {named} are zero in all rows{where} while the {other} ones change "
        "with frequency, as of no device with losses: a column was probably lost, or the numbers "
        f"became {other} in an export; save {first}_re and {first}_im (in import --map "
        f"{first}=RE+jIM)."
    )


def _lost(point: PointSweep, part: str, letter: str) -> tuple[str, ...]:
    """The entries of an operating point of which one part is zero, and the other changes."""
    values = point.admittance
    if len(values) < _ROWS or point.excitation is not None:
        return ()
    if letter == "Z":
        if (np.linalg.det(values) == 0).any():
            return ()
        values = np.linalg.inv(values)
    if _is_lossless(values):
        return ()
    real, imaginary = np.real(values), np.imag(values)
    lost, kept = (imaginary, real) if part == "imaginary" else (real, imaginary)
    largest = np.abs(kept).max(axis=0)
    changes = np.ptp(kept, axis=0) > _CHANGE * largest
    nothing = (np.abs(lost).max(axis=0) <= _ZERO * largest) & changes
    return tuple(name for name, place in ENTRIES.items() if nothing[place])


def _is_lossless(values: np.ndarray) -> bool:
    hermitian = np.abs(values + np.conj(np.swapaxes(values, 1, 2))) / 2
    return bool(hermitian.max() <= _LOSSLESS * np.abs(values).max())
