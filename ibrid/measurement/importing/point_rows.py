"""Which rows of a table are one operating point: as a column, p and q of each row, or the user say;
never by guess.

Frequencies that begin anew are two operating points, or one measured again: the numbers alone do
not say which.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ibrid.errors import SweepError, near, some
from ibrid.measurement.conventions.conversions import TO_SEQUENCE
from ibrid.measurement.formats.grouping import first_near, rows_of_each
from ibrid.measurement.importing.column_words import meaning_of, unit_of
from ibrid.measurement.importing.foreign_part import COLUMNS, OF_EACH, Part, in_volts, per_unit
from ibrid.measurement.importing.import_account import Account, bases_of, mind_power
from ibrid.measurement.importing.point_columns import names_in, require_named
from ibrid.measurement.importing.power_slips import mind_slips
from ibrid.measurement.importing.repeated_runs import ALIKE, distance, opposed_parts
from ibrid.measurement.importing.told import numbers_beside
from ibrid.measurement.sweeps.quantities import percent

#: Rows of a run that is more than a frequency measured again, and operating points that are listed
#: one by one in a question.
_RUN, _LISTED = 4, 12
#: Runs over the frequencies beyond one of each operating point: more are no sweep, and each is
#: compared with the first.
MOST_RUNS = 10_000
#: p and q that are said of runs that are averaged differ by at most this, per unit; p and q nearer
#: than the last are one point.
_ONE_POWER, _NEAR_POWER = 0.002, 0.02
#: A p or q in a name without a unit is per unit up to here.
_LARGEST_PU = 3.0
#: How near, as a part of |Y(0)|, the lowest frequency must be to the law of controlled p and q for
#: them to be read there.
_SETTLED = 0.25
#: Frequencies up to this factor above the lowest show whether most points deliver; |p + jq| from
#: which on it is told, per unit.
_LOWEST, _LOADED = 1.5, 0.02


def operating_points(parts: Sequence[Part], account: Account) -> list[Part]:
    """The parts with the rows of each operating point under one name, and p and q of each; asks for
    what nobody says.

    Raises SweepError where `--op` names what is not there.
    """
    asked = False
    placed, count = [], 0
    for part in parts:
        runs = _runs(part, account)
        count += len(runs)
        labels = {label for label, _ in runs}
        if len(runs) - len(labels) > MOST_RUNS:
            raise SweepError(
                f"{part.table.where} must have at most {MOST_RUNS:,} runs over the frequencies "
                "beyond one of each operating "
                f"point; found {len(runs) - len(labels):,}, is the column of frequencies the right "
                "one?"
            )
        if part.one_point or len(runs) == len(labels) or _names_all(part, account):
            placed.append(part)
        elif len(parts) == 1 and len(account.points) == len(runs):
            placed.append(_named_in_order(part, runs, account))
        elif _repeats_by_data(part) and _alike(part, runs, account):
            placed.append(part)
        else:
            _ask_of_runs(part, runs, account)
            asked = True
            placed.append(part)
    labels = list(dict.fromkeys(name for part in placed for name in part.names.tolist()))
    if any(part.named for part in placed) and len(account.points) == 1:
        require_named(account.points[0].name, np.array(labels, dtype=object), "the table")
    one_each = len(parts) > 1 and not any(part.named for part in parts)
    points = _said_of(labels, account, count, in_order=one_each)
    placed = [_with_powers(part, points, account) for part in placed]
    if not asked and any(_lacks(part).any() for part in placed):
        _ask_of_powers(placed, account)
    return placed


def run_starts(frequency: np.ndarray) -> np.ndarray:
    """Where frequencies that go up, or down, throughout begin anew; the first row is none."""
    step = np.sign(np.diff(frequency))
    direction = 1.0 if step.sum() >= 0 else -1.0
    return np.flatnonzero(step != direction) + 1


def _runs(part: Part, account: Account) -> list[tuple[str, np.ndarray]]:
    """(name of the point, rows) of every run over the frequencies, in the order of the file.

    A column numbers repeats; else a frequency that comes again at its amplitude makes runs, and so
    do stretches that begin anew and overlap, each of `_RUN` rows. Where p and q of each row tell
    points apart that have no names, they are the names.
    """
    runs: list[tuple[str, np.ndarray]] = []
    labels = _labels(part, account)
    for label, rows in rows_of_each(labels.tolist()).items():
        numbers = np.nan_to_num(part.repeat[rows])
        if np.isfinite(part.repeat[rows]).any():
            runs += [(label, rows[places]) for places in rows_of_each(numbers.tolist()).values()]
        else:
            runs += [
                (label, rows[places])
                for places in _split(part.frequency[rows], part.amplitude[rows])
            ]
    return runs


def _labels(part: Part, account: Account) -> np.ndarray:
    if (part.names != "").any() or not _has_powers(part):
        return part.names
    powers = np.stack([per_unit(role, part, account) for role in "pqv"], axis=-1)
    first = first_near(powers, _NEAR_POWER)
    mind_slips(part, powers, first, account)
    return np.array(
        [f"p={powers[k, 0]:.3g} q={powers[k, 1]:.3g} ({k})" for k in first], dtype=object
    )


def _has_powers(part: Part) -> bool:
    """Whether columns say p and q of each row."""
    return not part.told_once and not _lacks(part).any()


def _repeats_by_data(part: Part) -> bool:
    """Whether the file says what is a repeat: by a column, by p and q of each row, or by one name
    beside it for all.
    """
    return bool(np.isfinite(part.repeat).any() or part.table.op) or _has_powers(part)


def _alike(part: Part, runs: list[tuple[str, np.ndarray]], account: Account) -> bool:
    """Whether runs that would be averaged can be repeats: their admittances agree, and p and q that
    each of them keeps.
    """
    powers = np.stack([per_unit(role, part, account) for role in "pq"], axis=-1)
    first: dict[str, np.ndarray] = {}
    for label, rows in runs:
        before = first.setdefault(label, rows)
        here, beside, _ = _both(part, before, rows)
        apart = distance(here, beside)
        kept = (
            max(np.ptp(powers[before], axis=0).max(), np.ptp(powers[rows], axis=0).max())
            < _ONE_POWER / 10
        )
        if (
            apart > ALIKE
            or opposed_parts(here, beside, part.counting.frame)
            or (kept and np.abs(powers[rows[0]] - powers[before[0]]).max() > _ONE_POWER)
        ):
            return False
    return True


def _split(frequency: np.ndarray, amplitude: np.ndarray) -> list[np.ndarray]:
    keys = list(zip(frequency.tolist(), np.nan_to_num(amplitude).tolist(), strict=True))
    stretches = np.split(np.arange(len(frequency)), run_starts(frequency))
    again = len(set(keys)) < len(keys)
    if not again:
        spans = sorted((frequency[one].min(), frequency[one].max()) for one in stretches)
        overlap = any(low < high for (_, high), (low, _) in pairwise(spans))
        whole = min(map(len, stretches)) >= _RUN and np.isnan(amplitude).all()
        return stretches if overlap and whole else [np.arange(len(frequency))]
    if (
        all(len({keys[k] for k in one}) == len(one) for one in stretches)
        and min(map(len, stretches)) >= _RUN
    ):
        return stretches
    seen: dict[tuple[float, float], int] = {}
    number = np.zeros(len(keys), dtype=int)
    for k, key in enumerate(keys):
        number[k] = seen[key] = seen.get(key, -1) + 1
    return [*rows_of_each(number.tolist()).values()]


def _names_all(part: Part, account: Account) -> bool:
    """Whether the user named every operating point of the part, so that what comes again in one is
    a repeat.
    """
    return {*part.names.tolist()} <= {point.name for point in account.points if point.name}


def _named_in_order(part: Part, runs: list[tuple[str, np.ndarray]], account: Account) -> Part:
    """Each run is the operating point that `--op` says in its place; the same one again is a
    repeat.
    """
    names = part.names.copy()
    said = {point.name for point in account.points if point.name}
    for column in _telling_columns(part, runs):
        values = set(names_in(part.table, (column,)).tolist())
        if said & values and (unknown := sorted(said - values)):
            raise SweepError(
                f"--op {unknown[0]}: no operating point is called so in {column}; "
                f"{near(unknown[0], sorted(values))}"
            )
    for (_, rows), point in zip(runs, account.points, strict=True):
        same = next((k for k, one in enumerate(account.points, 1) if one == point), 0)
        names[rows] = point.name or f"op{same}"
    return replace(part, names=names)


def _said_of(
    labels: list[str], account: Account, runs: int, *, in_order: bool
) -> dict[str, dict[str, tuple[float, str]]]:
    """Name of a point -> role -> its number and dimension, as `--op` says them: by name, or in the
    order of the file.
    """
    said = account.points
    if not said:
        return {}
    if any(point.name for point in said):
        unknown = [point.name for point in said if point.name and point.name not in labels]
        if len(labels) == 1 and len(said) == 1:
            return {labels[0]: said[0].powers}
        distinct = list(dict.fromkeys(labels))
        if in_order and len(unknown) == len(said) == len(distinct):
            pairs = zip(distinct, said, strict=True)
            words = ", ".join(f"{label} has p and q of {point.name}" for label, point in pairs)
            account.remark(f"operating points in the order of the files: {words}")
            return {label: one.powers for label, one in zip(distinct, said, strict=True)}
        if unknown:
            raise SweepError(
                f"--op {unknown[0]}: no operating point is called so; {near(unknown[0], labels)}"
            )
        return {point.name: point.powers for point in said if point.name}
    distinct = list(dict.fromkeys(labels))
    ordered = [f"op{1 + next(k for k, one in enumerate(said) if one == point)}" for point in said]
    if set(ordered) == set(distinct):
        return {name: point.powers for name, point in zip(ordered, said, strict=True)}
    if len(said) != len(distinct):
        raise SweepError(
            f"--op must say p and q of each operating point; found {len(said)} for "
            f"{_counted(distinct, runs)}."
        )
    return {name: point.powers for name, point in zip(distinct, said, strict=True)}


def _counted(labels: list[str], runs: int) -> str:
    if labels == [""]:
        return f"{runs} run{'s' * (runs > 1)} over the frequencies"
    return f"{len(labels)}: {some(labels, _LISTED)}"


def _with_powers(
    part: Part, points: dict[str, dict[str, tuple[float, str]]], account: Account
) -> Part:
    """p, q and v of each operating point: as said, as the name of the point says, else as the table
    does where that can be.

    One p and q beside a table are those of one operating point.
    """
    labels = list(dict.fromkeys(part.names.tolist()))
    power = dict(part.power)
    if len(labels) > 1 and part.told_once:
        power |= {role: (np.full(len(part.names), np.nan), "per unit") for role in "pq"}
    for label, rows in rows_of_each(part.names.tolist()).items():
        powers = points.get(label) or {}
        if (
            not powers
            and np.isnan(power["p"][0][rows]).all()
            and np.isnan(power["q"][0][rows]).all()
        ):
            powers = _in_name(label)
            if powers:
                account.read("p, q", "the name of the point", "")
        for role, (value, dimension) in powers.items():
            values, own = power[role]
            values = values.copy()
            if np.isnan(values).all():
                own = dimension
            base = (
                bases_of(part.told, account) if {own, dimension} == {"power", "per unit"} else None
            )
            factor = 1.0 if base is None else base[0] if own == "power" else 1 / base[0]
            if role == "v" and own != "per unit":
                factor = _base_voltage(values, own, part, account)
            if label in points and (role != "v" or _states_voltage(part)):
                unit = (
                    {"p": "W", "q": "var"}.get(role, "")
                    if own == "power"
                    else "V" * (own == "voltage")
                )
                said, stands = np.full(len(rows), value * factor), values[rows]
                mind_power(
                    f"{role} of {label}" if label else role,
                    part.table.where,
                    role,
                    said,
                    stands,
                    stands,
                    unit,
                    account,
                )
            values[rows] = value * factor
            power[role] = values, own
    return replace(part, power=power)


def _base_voltage(values: np.ndarray, dimension: str, part: Part, account: Account) -> float:
    """What one per unit is among voltages of a table, that a voltage said per unit may stand beside
    them.
    """
    if not in_volts(values, dimension):
        return 1.0
    bases = bases_of(part.told, account)
    return bases[1] if bases else 1.0


def _states_voltage(part: Part) -> bool:
    """Whether a table says v, which is 1 where nothing does."""
    return part.told.get("v") is not None or any(
        meaning_of(name).role == "v" for name in part.table.columns
    )


def _in_name(label: str) -> dict[str, tuple[float, str]]:
    """p and q where the name of an operating point says both: P0.8_Q0.1."""
    found = numbers_beside(label, ())
    powers = {}
    for role in "pq":
        value, unit = found.get(role.upper(), (np.nan, ""))
        dimension, factor = unit_of(unit) or ("per unit", 1.0)
        if not np.isfinite(value) or (not unit and abs(value) > _LARGEST_PU):
            return {}
        powers[role] = value * factor, dimension
    return powers


def _lacks(part: Part) -> np.ndarray:
    """Rows without p or q."""
    return np.isnan(part.power["p"][0]) | np.isnan(part.power["q"][0])


def _ask_of_powers(parts: Sequence[Part], account: Account) -> None:
    rows = {}
    for part in parts:
        lacking = {*part.names[_lacks(part)].tolist()}
        for label, places in rows_of_each(part.names.tolist()).items():
            if label in lacking:
                rows.setdefault(label, (part, places))
    several = len(rows) > 1
    sentence = "the steady state p and q, delivered"
    if not several and len(parts) == 1 and not account.points:
        unit = str(parts[0].told.get("unit") or "")
        base = f" of {unit[3:].split(',')[0]}, as --unit says" if unit.startswith("pu:") else ""
        account.ask(sentence, f"--p 0.8 --q 0 (per unit{base})", COLUMNS)
        return
    named = [_point_to_say(label, *place) for label, place in [*rows.items()][:_LISTED]]
    options = " ".join(f"--op {text}" for text, _ in named) + " .." * (len(rows) > _LISTED)
    known = all(settled for _, settled in named)
    hint = (
        " (as the lowest frequencies read, if these are per unit and delivered: put right what is "
        "not so)" * known
    )
    of_each = (OF_EACH,) if len(parts) > 1 else ()
    account.ask(
        f"{sentence}, of each operating point: {some(rows, _LISTED)}",
        options + hint,
        *of_each,
        COLUMNS,
    )


def _ask_of_runs(part: Part, runs: list[tuple[str, np.ndarray]], account: Account) -> None:
    keys = _telling_columns(part, runs)
    labels = [label for label in dict.fromkeys(part.names.tolist()) if label]
    of = f" of {some(labels)}" if labels else ""
    told = f"; {keys[0]} tells them apart" if keys else ""
    sentence = (
        f"whether the {len(runs)} runs over the frequencies{of} are operating points or repeats of "
        "one ("
        f"{_difference(part, runs)}{told})"
    )
    if keys:
        values = names_in(part.table, keys[:1])
        places = {str(values[rows[0]]): rows for _, rows in reversed(runs)}
        named = [*reversed(places.items())]
    else:
        named = [("", rows) for _, rows in runs]
    texts = [_point_to_say(value, part, rows)[0] for value, rows in named[:_LISTED]]
    options = " ".join(f"--op {text}" for text in texts) + " .." * (len(named) > _LISTED)
    if len(labels) > 1:
        repeats = " ".join(f"--op {label}:p=P,q=Q" for label in labels[:_LISTED])
        account.ask(sentence, f"{options} (in this order)", f"{repeats} (repeats)")
    else:
        one = labels[0] if labels else "NAME"
        powers = "" if _has_powers(part) else " --p P --q Q"
        account.ask(
            sentence, f"{options} (points, in this order)", f"--op {one}{powers} (repeats of one)"
        )


def _telling_columns(part: Part, runs: list[tuple[str, np.ndarray]]) -> list[str]:
    """Columns nobody reads that have one value in each run and another in some."""
    telling = []
    for name in part.unused:
        column = part.table.columns[name]
        values = [{str(cell) for cell in column[rows].tolist()} for _, rows in runs]
        if all(len(one) == 1 for one in values) and len(set.union(*values)) > 1:
            telling.append(name)
    return telling


def _difference(part: Part, runs: list[tuple[str, np.ndarray]]) -> str:
    """How far the run that is farthest from the first one is from it, in words."""
    compared = [_both(part, runs[0][1], rows) for _, rows in runs[1:]]
    known = [(distance(here, beside), span) for here, beside, span in compared if len(here)]
    if not known:
        return "no frequencies of the first lie within another"
    apart, (low, high) = max(known)
    opposed = [
        name
        for here, beside, _ in compared
        for name in opposed_parts(here, beside, part.counting.frame)
    ]
    signs = f", with {some(opposed)} of the opposite sign" if opposed else ""
    return (
        f"they differ by {percent(apart)} in the median from {low:.3g} to {high:.3g} Hz, where "
        f"both are{signs}"
    )


def _both(
    part: Part, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Entries (m, 4) of a run where a second covers its frequencies, those of the second,
    interpolated, and the range.

    At the smallest amplitude, where there are several.
    """
    first, second = (_at_smallest(part, rows) for rows in (first, second))
    second = second[np.argsort(part.frequency[second], kind="stable")]
    f = part.frequency[second]
    low, high = (max(f[0], part.frequency[first].min()), min(f[-1], part.frequency[first].max()))
    first = first[(part.frequency[first] >= low) & (part.frequency[first] <= high)]
    other = part.matrix[second].reshape(-1, 4)
    at = part.frequency[first]
    beside = [
        np.interp(at, f, np.real(one)) + 1j * np.interp(at, f, np.imag(one)) for one in other.T
    ]
    return part.matrix[first].reshape(-1, 4), np.stack(beside, axis=1), (float(low), float(high))


def _at_smallest(part: Part, rows: np.ndarray) -> np.ndarray:
    amplitude = np.nan_to_num(part.amplitude[rows])
    return rows[amplitude == amplitude.min()]


def _point_to_say(label: str, part: Part, rows: np.ndarray) -> tuple[str, bool]:
    """What `--op` may say of an operating point, with the p and q that its lowest frequency shows;
    and whether it shows them.
    """
    read = _steady_state(part, rows)
    name = f"{label}:" if label else ""
    if re.search(r"\s", name):
        name = f'"{name}'
    return (f"{name}p={read[0]:.3g},q={read[1]:.3g}", True) if read else (f"{name}p=P,q=Q", False)


def _steady_state(part: Part, rows: np.ndarray) -> tuple[float, float] | None:
    """p and q at the lowest frequency, per unit, delivered; None where that does not follow the law
    of controlled p and q.

    Law: Y(0) = -[[p, -q], [-q, -p]] / v^2 with the current out of the inverter, of the other sign
    with it in. Where nobody says which, most operating points deliver.
    """
    counting = part.counting
    if part.unit != "pu" or counting.frame == "positive" or counting.network:
        return None
    positive = rows[part.frequency[rows] > 0]
    if not len(positive):
        return None
    at = positive[[np.argmin(part.frequency[positive])]]
    with np.errstate(all="ignore"):
        matrix = _in_dq(part, at)[0]
        lowest = part.frequency <= _LOWEST * part.frequency[part.frequency > 0].min()
        delivering = np.sum(
            np.real([1, -1] @ _in_dq(part, np.flatnonzero(lowest))[:, [1, 0], [1, 0]].T)
        )
    sign = {"in": -1.0, "out": 1.0}.get(str(part.told.get("current")), float(np.sign(delivering)))
    matrix = sign * matrix * float(np.nanmedian(part.power["v"][0][rows])) ** 2
    p, q = float(matrix[1, 1].real), float(matrix[0, 1].real)
    law = np.array([[-p, q], [q, p]])
    settled = np.linalg.norm(matrix - law) <= _SETTLED * np.linalg.norm(law)
    return (p, q) if settled and np.hypot(p, q) > _LOADED else None


def _in_dq(part: Part, rows: np.ndarray) -> np.ndarray:
    """(n, 2, 2) admittances in dq of some rows; not a number where an impedance is singular."""
    matrix = part.matrix[rows]
    if part.quantity.letter == "Z":
        singular = np.abs(np.linalg.det(matrix)) < 1e-12
        matrix = np.linalg.inv(np.where(singular[:, None, None], np.nan, matrix))
    return TO_SEQUENCE.conj().T @ matrix @ TO_SEQUENCE if part.quantity.sequence else matrix
