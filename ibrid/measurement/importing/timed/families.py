"""Which columns together are a recording: three phases, d and q, phasors, or root mean squares with
powers or currents.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ibrid.errors import SweepError, near, some
from ibrid.measurement.importing.timed.signal_names import (
    ColumnSignal,
    counted_in,
    signal_of,
    size_of,
    split_unit,
)
from ibrid.measurement.recordings.channels import place_by_number, require_one_role_each

_ABC = ("va", "vb", "vc", "ia", "ib", "ic")
_MAGNITUDES = tuple(f"{role}_{part}" for role in _ABC for part in ("mag", "ang"))
#: So many of a unit: `0.1 A`.
_COUNTED_UNIT = re.compile(r"(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*([^\s\d].*)")
#: What a voltage without an angle is called, the plainest first.
_SIZES = ("v_mag", "v", "vpos_mag", "vpos", "va_mag", "va")
#: What the first letter of a role measures.
_QUANTITIES = {
    "v": "a voltage",
    "i": "a current",
    "p": "active power",
    "q": "reactive power",
    "t": "a time",
    "f": "a frequency",
}
#: Active and reactive current, as programs call them.
_CURRENTS = (("ip", "iq"), ("id", "iq"), ("ip_mag", "iq_mag"))


@dataclass(frozen=True)
class Column:
    """A column that is taken: its `place` from 0, and what it is.

    `scaled` : whether `--channels` says how much one of its numbers is, `[0.1 A]`.
    """

    place: int
    signal: ColumnSignal
    scaled: bool = False


@dataclass(frozen=True)
class SignalFamily:
    """The columns of a recording.

    `kind` : "phases", "lines" (voltages between the phases), "dq", "phasors" (of three phases),
    "phasor" (one, or the positive sequence), "powers" or "currents" (of a voltage without an
    angle). `columns` : by role; t, record, sigma, f and an angle among them where they are there.
    `remarks` : where a unit or a quantity was said that is not that of the name.
    """

    kind: str
    columns: Mapping[str, Column]
    remarks: tuple[str, ...] = ()

    @property
    def scaled(self) -> frozenset[str]:
        """ "v" and "i", where `--channels` says how much the numbers of one such column are."""
        return frozenset(role[0] for role, column in self.columns.items() if column.scaled)


def signals_of(names: Sequence[str]) -> list[ColumnSignal]:
    """What each column of a table is; names of EMTP's nodes tell the phase by their last letter."""
    signals = [signal_of(name) for name in names]
    if any(name.endswith("_V") for name in names):  # va_V, ia_A, where VA_A is an angle
        behind = [signal_of(re.sub("_([VA])$", r" [\1]", name)) for name in names]
        pairs = zip(signals, behind, strict=True)
        signals = [two if two.phase and two.dimension else one for one, two in pairs]
    for quantity, begins in {"v": ("v:",), "i": ("c:", "i:")}.items():
        nodes = {
            k: _node(name)
            for k, name in enumerate(names)
            if name.strip().lower().startswith(begins)
        }
        phases = {k: node[-1] for k, node in nodes.items() if node and node[-1] in "abc"}
        if sorted(phases.values()) == ["a", "b", "c"] and len({nodes[k][:-1] for k in phases}) == 1:
            for k, phase in phases.items():
                signals[k] = replace(signals[k], quantity=quantity, phase=phase, part="")
    return signals


def _node(name: str) -> str:
    """The first node of `v:PCCA` and `c:PCCA -GRIDA`, in small letters."""
    return (
        name.split(":", 1)[1].strip().split()[0].split("-")[0].lower()
        if name.split(":", 1)[1].strip()
        else ""
    )


def family_of(names: Sequence[str], told: Mapping[str, str], where: str) -> SignalFamily | None:
    """The recording that columns make, as told and else as their names say; None where they make
    none.

    told : role -> number from 1 or name, perhaps with a unit, `3[kV]`.

    Raises SweepError where a role is told that is not there, or several columns have one that is
    needed.
    """
    taken, several = _taken(signals_of(names), names, told, where)
    roles = {*taken}
    if (
        {"v_mag", "va"} <= roles
        and not {"vb", "vc", "va_mag", "v_ang"} & roles
        and "p" not in roles
    ):
        for letter in "vi":  # VM and VA: size and angle
            if f"{letter}a" in taken:
                taken[f"{letter}_ang"] = taken.pop(f"{letter}a")
        roles = {*taken}
    for kind, needed in _kinds(roles):
        used = [role for role in needed if role in several and role not in told]
        if used:
            shown = [names[k] for k in several[used[0]]]
            raise SweepError(
                f"{where} must have one column for {used[0]}; {some(shown)} can be it, say which: "
                "--channels "
                f"{used[0]}={several[used[0]][0] + 1} (its number) or its name."
            )
        extra = [role for role in ("t", "record", "sigma", "f", "v_ang") if role in taken]
        columns = {role: taken[role] for role in (*needed, *extra)}
        remarks = (
            *_quantities_said_twice(columns, names, told),
            *_units_said_twice(columns, names, told),
        )
        return SignalFamily(kind, columns, remarks)
    return None


def columns_taken(names: Sequence[str], told: Mapping[str, str], where: str) -> dict[str, Column]:
    """Role -> its column, as told and else the first called so; SweepError as `family_of`."""
    return _taken(signals_of(names), names, told, where)[0]


def _kinds(roles: set[str]) -> list[tuple[str, tuple[str, ...]]]:
    """The families that the roles make, the fullest first, with the roles that each needs."""
    kinds: list[tuple[str, tuple[str, ...]]] = []
    if {*_ABC} <= roles:
        kinds.append(("phases", _ABC))
    if {"vab", "vbc", *_ABC[3:]} <= roles:
        kinds.append(("lines", ("vab", "vbc", *_ABC[3:])))
    if {"vd", "vq", "id", "iq"} <= roles:
        kinds.append(("dq", ("vd", "vq", "id", "iq")))
    if {*_MAGNITUDES} <= roles:
        kinds.append(("phasors", _MAGNITUDES))
    for phase in ("pos", "", "a", "b", "c"):
        four = tuple(f"{quantity}{phase}_{part}" for quantity in "vi" for part in ("mag", "ang"))
        bare = (f"v{phase}", four[1], f"i{phase}", four[3])
        kinds += [("phasor", one) for one in (four, bare) if {*one} <= roles]
    size = next((role for role in _SIZES if role in roles), "")
    if size and {"p", "q"} <= roles:
        kinds.append(("powers", (size, "p", "q")))
    kinds += [
        ("currents", (size, *pair))
        for pair in _CURRENTS
        if size and {*pair} <= roles and "vd" not in roles
    ]
    return kinds


def _taken(
    signals: Sequence[ColumnSignal], names: Sequence[str], told: Mapping[str, str], where: str
) -> tuple[dict[str, Column], dict[str, list[int]]]:
    """Role -> its column, as told and else the first that is called so; and the roles that several
    columns have.
    """
    taken: dict[str, Column] = {}
    for role, text in told.items():
        taken[role] = _told(role, text, signals, names, where)
    require_one_role_each({role: column.place for role, column in taken.items()}, names, where)
    used = {column.place for column in taken.values()}
    places: dict[str, list[int]] = {}
    for k, signal in enumerate(signals):
        if k not in used and signal.quantity:
            places.setdefault(signal.role, []).append(k)
    for role, found in places.items():
        taken.setdefault(role, Column(found[0], signals[found[0]]))
    return taken, {role: found for role, found in places.items() if len(found) > 1}


def _quantities_said_twice(
    columns: Mapping[str, Column], names: Sequence[str], told: Mapping[str, str]
) -> tuple[str, ...]:
    """Remarks on columns that `--channels` takes for another quantity than their names say."""
    remarks = []
    for role in columns.keys() & told.keys():
        column = columns[role]
        named = column.signal.quantity
        if named and role[0] in _QUANTITIES and named[0] != role[0]:
            said = _QUANTITIES.get(named[0], named)
            remarks.append(
                f"{role}: {names[column.place]} as said, while its name says {said} and not "
                f"{_QUANTITIES[role[0]]}"
            )
    return tuple(sorted(remarks))


def _kind_of_power(unit: str) -> str:
    """The unit of a power without its prefix, W, var or VA, in small letters; "" for others."""
    return next((kind for kind in ("var", "va", "w") if unit.strip().lower().endswith(kind)), "")


def _units_said_twice(
    columns: Mapping[str, Column], names: Sequence[str], told: Mapping[str, str]
) -> tuple[str, ...]:
    """Remarks on units that `--channels` says otherwise than the names of their columns."""
    remarks = []
    for role in columns.keys() & told.keys():
        name = names[columns[role].place]
        (_, said), (_, written) = _with_unit(told[role], names), split_unit(name)
        if not said or not written or columns[role].scaled:
            continue
        counted = counted_in(said) | counted_in(f"{written} {name}")
        opposite = {"line", "phase"} <= counted or {"rms", "peak"} <= counted
        other_power = _kind_of_power(said) != _kind_of_power(written)
        if size_of(said) != size_of(written) or opposite or other_power:
            remarks.append(f"unit of {role}: {said} as said, while its name says {written}")
    return tuple(sorted(remarks))


def _with_unit(text: str, names: Sequence[str]) -> tuple[str, str]:
    """Number or name of a channel, and the unit in brackets behind it, "" without one."""
    bare = text.strip()
    if bare in names or not bare.endswith("]") or "[" not in bare:
        return bare, ""
    channel, unit = bare[:-1].rsplit("[", 1)
    return channel.strip(), unit.strip()


def _size_said(unit: str) -> tuple[str, float] | None:
    """What a unit measures, and how much of it one number is: of `0.1 A` behind a probe 0.1."""
    counted = _COUNTED_UNIT.fullmatch(unit)
    size = size_of(counted[2] if counted else unit)
    if counted is None or size is None:
        return size
    return size[0], size[1] * float(counted[1])


def _place_said(channel: str, names: Sequence[str]) -> int | None:
    """The place of a channel, by its name, its name without the unit, or its number from 1 on; None
    for none.
    """
    if channel in names:
        return names.index(channel)
    bare = [k for k, name in enumerate(names) if split_unit(name)[0] == channel]
    if len(bare) == 1:
        return bare[0]
    return place_by_number(channel, len(names))


def _told(
    role: str, text: str, signals: Sequence[ColumnSignal], names: Sequence[str], where: str
) -> Column:
    """The column that `--channels` names for a role, by number from 1 or by name, with its unit
    where one is said.
    """
    bare, unit = _with_unit(text, names)
    size = _size_said(unit)
    if bare != text.strip() and size is None:
        raise SweepError(
            f"--channels {role}={text[:40]}: a unit must be V, A, W, var, s, Hz, deg or pu, "
            "also with k, M or m, or so many of them such as 0.1 A behind a probe; found "
            f"{unit[:20]!r}."
        )
    place = _place_said(bare, names)
    if place is None:
        raise SweepError(
            f"{where}: there is no channel {bare[:40]!r} for {role}; {near(bare, names)}"
        )
    signal = signals[place]
    if not unit and not signal.dimension:  # as of a current whose name says mV
        size = size_of(split_unit(names[place])[1])
    dimension, factor = size or (signal.dimension, signal.factor)
    _require_fit(role, dimension, names[place], text, where)
    counted = counted_in(unit) or signal.counted
    signal = replace(signal, dimension=dimension, factor=factor, counted=counted)
    return Column(place, signal, scaled=_COUNTED_UNIT.fullmatch(unit) is not None)


def _require_fit(role: str, dimension: str, name: str, text: str, where: str) -> None:
    """SweepError for a current in V, as a probe gives it."""
    if dimension == "voltage" and role[0] == "i" and not role.endswith("_ang"):
        raise SweepError(
            f"{where}: {name} must be a current for {role}, and is in V as of a probe; say how "
            f"many A one of its numbers is: --channels {role}={text.partition('[')[0]}[0.1A]."
        )
