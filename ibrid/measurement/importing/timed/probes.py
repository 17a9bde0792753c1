"""Currents that stand in volts, as probes, shunts and transducers give them: how many amperes one
of their numbers is.
"""

import re
from collections.abc import Iterable, Mapping, Sequence

from ibrid.errors import some
from ibrid.measurement.importing.timed.signal_names import signal_of, size_of, split_unit

#: What a probe gives for an ampere: 10 mV/A.
_SENSITIVITY = re.compile(r"(?<![\d.,])(\d+(?:[.,]\d+)?)\s*([mµu]?)V\s*/\s*(k?)A\b")
#: The other way about: 100 A/V.
_INVERSE = re.compile(r"(?<![\d.,])(\d+(?:[.,]\d+)?)\s*(k?)A\s*/\s*([mµu]?)V\b")
_PREFIXES = {"": 1.0, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "k": 1e3}
#: One of which a question speaks where nothing tells it, V per A.
_EXAMPLE = 0.01


def volts_per_ampere(comments: Iterable[str]) -> tuple[float, ...]:
    """What comments tell of probes, each once."""
    told = []
    for comment in comments:
        told += [
            float(size.replace(",", ".")) * _PREFIXES[volts] / _PREFIXES[amperes]
            for size, volts, amperes in _SENSITIVITY.findall(comment)
        ]
        told += [
            _PREFIXES[volts] / (float(size.replace(",", ".")) * _PREFIXES[amperes])
            for size, amperes, volts in _INVERSE.findall(comment)
            if float(size.replace(",", ".")) > 0
        ]
    return tuple(dict.fromkeys(size for size in told if size > 0))


def currents_in_volts(names: Sequence[str]) -> dict[str, int]:
    """Role -> place of the columns that are called currents, and whose unit is V."""
    places: dict[str, int] = {}
    for place, name in enumerate(names):
        bare, unit = split_unit(name)
        signal = signal_of(bare)
        in_volts = (size_of(unit) or ("",))[0] == "voltage"
        if in_volts and signal.quantity == "i" and signal.part != "ang":
            places.setdefault(signal.role, place)
    return places


def with_currents_in_volts(names: Sequence[str]) -> list[str]:
    """The names, those of currents in V without their unit."""
    places = {*currents_in_volts(names).values()}
    return [split_unit(name)[0] if k in places else name for k, name in enumerate(names)]


def probe_question(
    names: Sequence[str], told: Mapping[str, str], sensitivities: Sequence[float]
) -> str:
    """What must be said of currents in V, with the option; "" where nothing must.

    told : role -> what `--channels` says of it. sensitivities : V per A, as comments tell them.
    """
    places = {role: k for role, k in currents_in_volts(names).items() if role not in told}
    if not places:
        return ""
    volts_of_ampere = sensitivities[0] if len(sensitivities) == 1 else _EXAMPLE
    channels = []
    for role, place in places.items():
        volt = (size_of(split_unit(names[place])[1]) or ("", 1.0))[1]
        channels.append(f"{role}={place + 1}[{volt / volts_of_ampere:.6g}A]")
    shown = some([names[place] for place in places.values()])
    said = [f"{role}={text}" for role, text in told.items()]
    return (
        f"how many A one number of {shown} is, which are in V as of a probe: add --channels "
        f"{','.join([*said, *channels])} (of {volts_of_ampere * 1e3:g} mV/A)"
    )
