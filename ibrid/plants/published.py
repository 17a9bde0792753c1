"""Reference inverters that ship: the fixed benchmark and published parameter sets, read from
published.toml.
"""

import tomllib
from collections.abc import Callable, Mapping
from importlib.resources import files
from math import pi, sqrt
from types import MappingProxyType
from typing import Any

from ibrid.plants.gfl import GFLParameters
from ibrid.plants.gfm import DroopParameters, OscillatorParameters, VSMParameters
from ibrid.plants.hybrid import HybridParameters
from ibrid.plants.parallel import ParallelParameters
from ibrid.plants.reference import ReferenceInverter

_FAMILIES: Mapping[str, Callable[..., Any]] = {
    "grid-following": GFLParameters,
    "droop": DroopParameters,
    "virtual machine": VSMParameters,
    "virtual oscillator": OscillatorParameters,
    "hybrid": HybridParameters,
    "parallel": ParallelParameters,
}


def _read() -> dict[str, ReferenceInverter]:
    """Name -> inverter, in the order of the file; one that is made of others refers to earlier
    ones.
    """
    plants: dict[str, ReferenceInverter] = {}
    for name, table in tomllib.loads(
        (files("ibrid.plants") / "published.toml").read_text(encoding="utf-8")
    ).items():
        units = {"omega_0": 2 * pi * table["f0_hz"], "Hz": 2 * pi}
        if "v_base_v" in table:
            units["V_peak"] = table["v_base_v"] * sqrt(2 / 3)
            table["s_base_va"] = units["S_base"] = _value(table["s_base_va"], units)
            units["Z_base"] = table["v_base_v"] ** 2 / units["S_base"]
            units["I_peak"] = units["S_base"] / (1.5 * units["V_peak"])
        parameters = {
            key: plants[value].parameters if value in plants else _value(value, units)
            for key, value in table.pop("parameters").items()
        }
        plants[name] = ReferenceInverter(
            name, _FAMILIES[table.pop("family")](**parameters), **table
        )
    return plants


def _value(text: Any, units: Mapping[str, float]) -> Any:
    """A number with what converts it, "2.0 * omega_0 / Z_base", multiplied from left to right;
    anything else as it is.
    """
    first, *factors = str(text).split(" ")
    if not factors:
        return text
    value = float(first)
    for sign, word in zip(factors[::2], factors[1::2], strict=True):
        number = units[word] if word in units else float(word)
        value = value * number if sign == "*" else value / number
    return value


PLANTS: Mapping[str, ReferenceInverter] = MappingProxyType(_read())
PAPER_LIKE = PLANTS["paper_like"]
#: With the structure of the paper.
PUBLISHED = tuple(
    PLANTS[name]
    for name in (
        "sienna_gfl",
        "sienna_lcl",
        "sting_100mva",
        "feng_50kva",
        "kuleuven_600mva",
        "touti_19kva",
    )
)
#: One inverter of each other kind, named as its textbook diagram and its sweep.
BEYOND = tuple(plant for plant in PLANTS.values() if plant not in (PAPER_LIKE, *PUBLISHED))
