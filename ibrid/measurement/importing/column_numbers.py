"""The numbers of a column, or of two that are joined, and the unit in which they stand."""

from collections.abc import Sequence

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.importing.cell_number import number
from ibrid.measurement.importing.column_map import Source
from ibrid.measurement.importing.column_words import meaning_of, unit_of
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account

#: Ten turns, rad: a phase that was not wrapped stays below.
_MOST_RADIANS = 20 * np.pi
#: How to say that magnitudes are in dB.
_ALL_IN_DECIBELS = "write [dB] into the names of all that are, such as --map Ydd=MAG[dB]@PHASE[deg]"


def real_numbers(table: ForeignTable, source: Source) -> tuple[np.ndarray, str, float]:
    """Numbers of a source in the plain unit of their dimension."""
    if source.constant is not None:
        dimension, factor = unit_of(source.unit) or ("", 1.0)
        return np.full(len(table.line), source.constant * factor), dimension, factor
    name = source.columns[0]
    require_real(table, name)
    _require_finite(table, name)
    dimension, factor = unit_of(source.unit or meaning_of(name).unit) or ("", 1.0)
    return table.columns[name] * factor, dimension, factor


def in_unit_of_matrix(
    values: np.ndarray, table: ForeignTable, source: Source, unit: str
) -> np.ndarray:
    """Standard deviations in the unit in which the matrix is written; SweepError where theirs is of
    another kind, or relative.

    A part in dB or %, or beside magnitudes in dB, is one of each entry, of each peak, or of one per
    unit: nobody knows.
    """
    dimension, size = unit_of(unit_written(source)) or ("", 1.0)
    of_decibels = (unit_of(unit) or ("",))[0] == "decibel"
    percent = "%" in unit_written(source) and "%" not in unit
    if dimension == "decibel" or percent or (of_decibels and not dimension):
        raise SweepError(
            f"{table.where}: {words_of(source)} must be the standard deviation of each real and "
            "each imaginary part, in the unit "
            "of the admittance or impedance; found one that may be relative, convert it, or leave "
            "the column out."
        )
    of_matrix = unit_of(unit)
    if not dimension or of_matrix is None:
        return values / size
    if dimension != of_matrix[0]:
        raise SweepError(
            f"{table.where}: {words_of(source)} must be in the unit of the matrix, {unit}; found "
            f"{unit_written(source)}, "
            "convert it, or leave the column out."
        )
    return values / of_matrix[1]


def require_real(table: ForeignTable, name: str) -> None:
    """Raise SweepError unless a column holds real numbers and empty cells alone."""
    values = table.columns[name]
    if values.dtype.kind != "f":
        bad = next((k for k, value in enumerate(values.tolist()) if not _is_real(value)), 0)
        raise SweepError(
            f"{table.place(bad, name)} must be a number; found {str(values[bad])[:40]!r}, correct "
            "it."
        )


def _require_finite(table: ForeignTable, name: str, *, decibel: bool = False) -> None:
    """Raise SweepError where a number is infinite; in decibels minus infinity is a magnitude of
    zero.
    """
    values = table.columns[name]
    endless = np.isinf(values) & (values != -np.inf if decibel else True)
    if endless.any():
        row = int(endless.argmax())
        raise SweepError(
            f"{table.place(row, name)} must be finite; found {values[row]} (infinite, or too large "
            "for a number), correct it or "
            "leave the row out."
        )


def _is_real(value: object) -> bool:
    """Whether a cell of a column that holds other things too is a real number."""
    if isinstance(value, str):
        value = None if "," in value else number(value, False)
    return isinstance(value, float) or (isinstance(value, complex) and not value.imag)


def unsaid_decibels(
    table: ForeignTable, sources: Sequence[Source], said_unit: str, account: Account
) -> bool:
    """Whether the magnitudes that say no unit are in dB: as the user says of the matrix, or where
    those of each entry go below zero.

    Raises SweepError where those of some entries alone do, where some entries say dB and others
    nothing, where another table of the import decides otherwise, and for a negative magnitude in a
    unit other than dB.
    """
    polar = [source for source in sources if source.joined == "@"]
    below, above, said = [], [], []
    for source in polar:
        name = source.columns[0]
        dimension = _dimension(source)
        negative = _is_below(table, name)
        if dimension == "decibel":
            said.append(source)
        elif negative:
            below.append(source)
        elif not dimension:
            above.append(source)
        if negative and dimension not in ("", "decibel"):
            _refuse_exchanged(table, source, polar)
            raise _negative_magnitude(table, source, f" in {unit_written(source)}")
    if (unit_of(said_unit) or ("",))[0] == "decibel":
        account.decibels.setdefault(True, table.where)
        return True
    if below and above:
        raise _negative_magnitude(
            table, below[0], f", while no {above[0].columns[0]} is below zero"
        )
    unsaid = below or above
    if unsaid and said:
        raise SweepError(
            f"{table.where}: all magnitudes must say dB, or none; found {said[0].columns[0]} in dB "
            f"beside {unsaid[0].columns[0]}, which says nothing, {_ALL_IN_DECIBELS}."
        )
    decibel = bool(below)
    if unsaid:
        account.decibels.setdefault(decibel, table.where)
    if len(account.decibels) > 1:
        raise SweepError(
            "magnitudes of all tables must be in dB, or none; found some below zero in "
            f"{account.decibels[True]}, as decibels are, and none in {account.decibels[False]}, "
            f"{_ALL_IN_DECIBELS}."
        )
    if decibel:
        account.remark("magnitudes taken as dB, as those of each entry go below zero")
    return decibel


def _refuse_exchanged(table: ForeignTable, source: Source, polar: Sequence[Source]) -> None:
    """Raise SweepError where the phase beside a negative magnitude is nowhere below zero, while
    phases of other entries are.
    """
    size, phase = source.columns
    positive = [name for _, name in (one.columns for one in polar) if not _is_below(table, name)]
    if positive != [phase]:
        return
    meaning, names = meaning_of(size), [*table.columns]
    raise SweepError(
        f"{table.where}: {size} and {phase} are probably exchanged; found numbers below zero in "
        "the magnitude and none in the phase, exchange their names, or add --map "
        f"{meaning.letter}{meaning.entry}=#{names.index(phase) + 1}[{meaning.unit}]"
        f"@#{names.index(size) + 1}[{meaning_of(phase).unit or 'deg'}]."
    )


def _is_below(table: ForeignTable, name: str) -> bool:
    """Whether a column has numbers below zero."""
    require_real(table, name)
    return bool((table.columns[name] < 0).any())


def _dimension(source: Source) -> str:
    """What the unit of a source, or else the name of its first column, measures; "" for none."""
    return (unit_of(source.unit or meaning_of(source.columns[0]).unit) or ("",))[0]


def _negative_magnitude(table: ForeignTable, source: Source, why: str) -> SweepError:
    name = source.columns[0]
    row = int((table.columns[name] < 0).argmax())
    return SweepError(
        f"{table.place(row, name)} must be zero or more, as a magnitude that is not in dB is; "
        f"found {table.columns[name][row]:.4g}{why}, {_ALL_IN_DECIBELS}, or turn the phases of "
        "negative ones by half a turn."
    )


def complex_numbers(
    table: ForeignTable, source: Source, account: Account, *, unsaid_decibel: bool
) -> tuple[np.ndarray, str]:
    """The numbers of an entry as they stand, without their unit; and what they are besides: "dB,
    degrees".

    unsaid_decibel : whether a magnitude that says no unit is in dB.
    """
    if source.constant is not None:
        return np.full(len(table.line), complex(source.constant)), ""
    if not source.joined:
        name = source.columns[0]
        if table.columns[name].dtype.kind != "c":
            require_real(table, name)
        elif (unit_of(unit_written(source)) or ("",))[0] == "decibel":
            raise SweepError(
                f"{table.where}: {name} must not be in dB, in which no complex number is; found "
                f"{str(table.columns[name][0])[:40]}, write decibels and angles into columns of "
                "their own, Ydd_mag [dB] and Ydd_phase [deg]."
            )
        _require_finite(table, name)
        return table.columns[name].astype(complex), ""
    first, second = (table.columns[name] for name in source.columns)
    for name in source.columns:
        require_real(table, name)
        _require_finite(table, name, decibel=source.joined == "@" and name == source.columns[0])
    if source.joined == "j":
        return first + 1j * second * _imaginary_over_real(table, source), ""
    named = [unit_of(meaning_of(name).unit) or ("", 1.0) for name in source.columns]
    named[1] = unit_of(source.angle) or named[1]
    if not named[1][0].startswith("angle") and named[1][0]:
        found = source.angle or meaning_of(source.columns[1]).unit
        raise SweepError(
            f"{table.where}: {source.columns[1]} must be a phase in deg or rad; found [{found}], "
            "correct it."
        )
    if (
        named[1][0] == "angle in radians"
        and named[1][1] == 1.0
        and largest_phase(second) > _MOST_RADIANS
    ):
        raise SweepError(
            f"{table.where}: {source.columns[1]} must be in rad, as it says; found up to "
            f"{largest_phase(second):.4g}, which are "
            f"degrees: write deg into its name, or --map .. @{source.columns[1]}[deg]."
        )
    dimension = _dimension(source)
    decibel = dimension == "decibel" or (not dimension and unsaid_decibel)
    largest = largest_phase(second)
    degrees = named[1][0] == "angle" or (named[1][0] != "angle in radians" and largest > 2 * np.pi)
    if not named[1][0] and largest <= 2 * np.pi:
        account.ask(
            f"whether {source.columns[1]} is in degrees or radians",
            f"[deg] or [rad] to the name of {source.columns[1]}",
        )
    size = 10 ** (first / 20) if decibel else first
    angle = np.deg2rad(second) if degrees else second * named[1][1]
    return size * np.exp(
        1j * angle
    ), f"{'dB' if decibel else 'magnitude'}, {'degrees' if degrees else 'rad'}"


def largest_phase(values: np.ndarray) -> float:
    """The largest size of an angle, 0 where none is there."""
    return float(np.nanmax(np.abs(values), initial=0.0))


def _imaginary_over_real(table: ForeignTable, source: Source) -> float:
    """The unit of the imaginary part in that of the real part, 1 where one of them alone says a
    unit.

    Raises SweepError where they measure different things, and where the map says the unit of one
    and the name that of the other.
    """
    first, second = source.columns
    names = [meaning_of(name).unit for name in source.columns]
    if source.imaginary:
        units = [source.unit, source.imaginary]
    elif source.unit:
        units = [source.unit] * 2
        if other := next(
            (unit for unit in names if unit and unit_of(unit) != unit_of(source.unit)), ""
        ):
            raise SweepError(
                f"{table.where}: --map must say the unit of {first} and that of {second}, or "
                f"neither; found [{source.unit}] "
                f"once, while a name says [{other}], write one behind each: "
                f"{first}[..]+j{second}[..]."
            )
    else:
        units = names
    if not all(units):
        return 1.0
    (dimension, size), (other_dimension, other_size) = (
        unit_of(unit) or ("", 1.0) for unit in units
    )
    if dimension != other_dimension:
        raise SweepError(
            f"{table.where}: both parts of an entry must be in units of one kind; found {first} in "
            f"{units[0]} beside {second} in "
            f"{units[1]}, correct one or say both: {first}[..]+j{second}[..]."
        )
    return other_size / size


def words_of(source: Source) -> str:
    """A source, for people: its columns, or what is said in their place."""
    if source.constant is not None:
        return f"{source.name} {source.constant:g}".strip()
    joint = {"j": " + j ", "@": " at angle "}.get(source.joined, source.joined)
    return joint.join(source.columns) or source.unit


def unit_written(source: Source) -> str:
    """The unit that stands there, of a real part or else of its imaginary part; "" for none."""
    named = source.columns if source.joined == "j" else source.columns[:1]
    return source.unit or next(filter(None, (meaning_of(name).unit for name in named)), "")
