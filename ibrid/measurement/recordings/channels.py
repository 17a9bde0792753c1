"""Which channels of a recorder are the three voltages and currents: by their names, units and
phases, or as told.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ibrid.errors import SweepError, near

#: What a channel can be, in the order of Samples; phase to phase voltages serve too.
PHASES = ("va", "vb", "vc", "ia", "ib", "ic")
BETWEEN = ("vab", "vbc", "vca")
DQ = ("vd", "vq", "id", "iq")
#: Voltages between the phases that are counted the other way, as of two wattmeters.
REVERSED = ("vba", "vcb", "vac")
ROLES = (*PHASES, *BETWEEN, *REVERSED, *DQ, "v", "p", "q", "ip", "f", "t", "record", "sigma")
#: Magnitude and angle of phasors, of three phases, one, or the positive sequence.
PHASORS = tuple(
    f"{quantity}{phase}_{part}"
    for quantity in "vi"
    for phase in ("a", "b", "c", "")
    for part in ("mag", "ang")
)
#: What tables may hold in place of three phases, for sentences.
OTHER_FAMILIES = (
    ", or vab=,vbc=,ia=,ic= of three wires (vcb and the like counted the other way), "
    "vd=,vq=,id=,iq=, v_mag=,v_ang=,i_mag=,i_ang= or v=,p=,q="
)
#: What fewer channels than a time, three voltages and three currents may be.
_FEWER = (
    "t=1,vd=2,vq=3,id=4,iq=5",
    "t=1,v_mag=2,v_ang=3,i_mag=4,i_ang=5",
    "t=1,v=2,p=3,q=4",
)
_LETTERS = {"a": "a|l1|r|1", "b": "b|l2|s|y|2", "c": "c|l3|t|w|3"}
_QUANTITY = {"v": r"v|u|volt(age)?|spannung", "i": r"i|amp(ere)?s?|curr(ent)?|strom"}


#: Channels as a user names them: `va=1,vb=VB L1,...`, or role -> name or number.
ToldChannels = str | Mapping[str, object] | None


@dataclass(frozen=True)
class Channel:
    """What is known of a channel before its samples: name, unit and phase as they are written."""

    name: str
    unit: str = ""
    phase: str = ""


def channels_told(text: ToldChannels) -> dict[str, str]:
    """`va=1,vb=VB L1,...` as role -> name or number; SweepError for an unknown role."""
    if not text:
        return {}
    pairs = (
        text.items()
        if isinstance(text, Mapping)
        else (item.partition("=")[::2] for item in text.split(","))
    )
    plain = {role.replace("_", ""): role for role in (*ROLES, *PHASORS)}
    named = {str(role).strip().lower().replace("_", ""): str(name).strip() for role, name in pairs}
    named = {plain.get(role, role): name for role, name in named.items()}
    for role, name in named.items():
        if role not in plain.values() or not name:
            raise SweepError(
                "--channels is written va=1,vb=2,vc=3,ia=4,ib=5,ic=6, numbers or names; found "
                f"{role[:40]}={name[:40]}, "
                f"{near(role, ROLES)}"
            )
    return named


def chosen(
    channels: Sequence[Channel], told: Mapping[str, str], where: str, others: str = ""
) -> dict[str, int]:
    """Role -> place of its channel: as told, by number from 1 or by name; the others where one
    channel alone fits. others : what may be told in place of phases, for sentences.

    Raises SweepError that lists the channels where a role has none or several.
    """
    names = [channel.name for channel in channels]
    placed: dict[str, int] = {}
    for role, name in told.items():
        place = names.index(name) if name in names else place_by_number(name, len(names))
        if place is None:
            raise SweepError(
                f"{where}: there is no channel {name[:40]!r} for {role}; {_listed(names)}"
            )
        placed[role] = place
    if any(set(family) <= set(placed) for family in (DQ, (*BETWEEN, *PHASES[3:]))):
        return placed
    lacking: dict[str, int] = {}
    for role in PHASES:
        if role in placed or (role[0] == "v" and set(BETWEEN) <= set(placed)):
            continue
        fitting = [
            k
            for k, channel in enumerate(channels)
            if role_of(channel) == role and k not in placed.values()
        ]
        if len(fitting) == 1:
            placed[role] = fitting[0]
        else:
            lacking[role] = len(fitting)
    if lacking:
        role, count = next(iter(lacking.items()))
        asked = [*(["t"] if others and "t" not in placed else []), *lacking]
        if others and len(names) < len(placed) + len(asked):
            raise SweepError(_too_few(names, where))
        free = (k for k in range(1, len(names) + 8) if k - 1 not in placed.values())
        numbers = {role: placed[role] + 1 for role in told} | dict(zip(asked, free, strict=False))
        answer = ",".join(f"{role}={number}" for role, number in numbers.items())
        raise SweepError(
            f"{where} must have one channel for {role}; found {count or 'none'} that "
            f"its name and unit show, tell them: --channels {answer}{others}; {_listed(names)}"
        )
    return placed


def _too_few(names: Sequence[str], where: str) -> str:
    answers = [answer for answer in _FEWER if answer.count("=") <= len(names)]
    answer = f"tell what they are: --channels {' or '.join(answers)}"
    return (
        f"{where} must have a time, three voltages and three currents; found {len(names)} "
        f"channels, {answer if answers else 'add those that lack'}; {_listed(names)}"
    )


def place_by_number(text: str, count: int) -> int | None:
    """The place from 0 of the channel `3` or `#3` of so many; None for anything else."""
    digits = text.removeprefix("#")
    return int(digits) - 1 if digits.isdigit() and 0 < int(digits) <= count else None


def require_one_role_each(placed: Mapping[str, int], names: Sequence[str], where: str) -> None:
    """Raise SweepError where one channel is told for two roles."""
    first: dict[int, str] = {}
    for role, place in placed.items():
        if place in first:
            raise SweepError(
                f"{where}: channel {place + 1} ({names[place][:40]}) must be told for one role; "
                f"found {first[place]} and {role}, say another channel for one of them."
            )
        first[place] = role


def role_of(channel: Channel) -> str:
    """va .. ic as name, unit and phase of a channel show it; "" for anything else."""
    compact = re.sub(r"[^a-z0-9]", "", channel.name.lower())
    unit = re.sub(r"^[kmµu](?=[va]$)", "", channel.unit.strip().lower())
    for quantity, word in _QUANTITY.items():
        if unit and unit != {"v": "v", "i": "a"}[quantity]:
            continue
        for letter, phase in _LETTERS.items():
            said = re.fullmatch(rf"({phase})n?", channel.phase.strip().lower())
            named = re.fullmatch(rf"({word})?(ph(ase)?)?({phase})[ng]?(pcc)?", compact)
            named = named or re.fullmatch(rf"(ph(ase)?)?({phase})({word})", compact)
            measured = unit or re.match(word, compact) or re.search(f"({word})$", compact)
            if measured and (said or (named and not channel.phase.strip())):
                return quantity + letter
    return ""


def _listed(names: Sequence[str]) -> str:
    return f"the channels are {', '.join(f'{k} {name}' for k, name in enumerate(names[:40], 1))}."
