"""A controller as choices: for each part that an inverter may have, which variant it has.

A part that is left out is not there; the empty choice is the naive start of the search. Names of
parts and variants are this file's own; `ibrid_policy.experience.drawn_diagram` says what they look
like as a block diagram.
"""

from collections.abc import Mapping
from types import MappingProxyType

#: Part -> variant.
Choices = Mapping[str, str]

#: Every part and its variants, in the order in which a diagram is put together.
PARTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "filter": ("LCL", "LCL_R", "LCL_RC", "LLFilter"),
        "frame": ("pll", "droop", "filtered droop", "machine", "hybrid", "oscillator"),
        "pll filter": ("low-pass", "notch"),
        "current": ("converter", "grid", "proportional"),
        "current filter": ("loop", "both"),
        "voltage": ("PI",),
        "p": ("power", "dc link"),
        "q": ("power", "magnitude", "droop", "filtered droop"),
        "power filter": ("low-pass",),
        "same gains": ("yes",),
        "same corners": ("yes",),
        "feedforward": ("unit", "scaled", "filtered"),
        "decoupling": ("nominal", "measured"),
        "voltage decoupling": ("nominal", "measured"),
        "damping": ("capacitor current", "fast voltage"),
        "virtual impedance": ("command", "reference", "reactance"),
        "frequency droop": ("plain", "filtered"),
        "delay": ("command",),
        "shunt": ("RC",),
    }
)
#: What the paper's vocabulary has in place of a variant; "" where it has nothing.
IN_THE_PAPER: Mapping[tuple[str, str], str] = MappingProxyType(
    {
        ("filter", "LCL_R"): "LCL",
        ("filter", "LCL_RC"): "LCL",
        ("filter", "LLFilter"): "",
        ("frame", "machine"): "filtered droop",
        ("frame", "oscillator"): "droop",
        ("p", "dc link"): "",
        ("decoupling", "measured"): "nominal",
        ("voltage decoupling", "measured"): "nominal",
        ("shunt", "RC"): "",
    }
)
_CAPACITOR = ("LCL", "LCL_R", "LCL_RC")


def consistent(choices: Choices) -> dict[str, str]:
    """The choices without those that need a part which is not there, in the order of `PARTS`."""
    found = dict(choices)
    while True:
        kept = {
            part: found[part]
            for part in PARTS
            if part in found and _possible(part, found[part], found)
        }
        if len(kept) == len(found):
            return kept
        found = kept


def _possible(part: str, variant: str, others: Choices) -> bool:
    frame, power = others.get("frame"), {others.get("p"), others.get("q")}
    capacitor = others.get("filter") in _CAPACITOR
    needs = {
        "pll filter": frame in ("pll", "hybrid"),
        "current filter": "current" in others,
        "voltage": capacitor and "current" in others,
        "power filter": "power" in power,
        "same gains": others.get("p") == others.get("q") == "power",
        "same corners": others.get("p") == others.get("q") == "power" and "power filter" in others,
        "voltage decoupling": "voltage" in others and (variant == "nominal" or frame is not None),
        "decoupling": variant == "nominal" or frame is not None,
        "damping": capacitor,
        "frequency droop": frame == "pll" and others.get("p") == "power",
        "virtual impedance": variant == "command" or "current" in others,
    }
    if (part, variant) == ("current", "grid"):
        return capacitor
    return needs.get(part, True)


def in_the_paper(choices: Choices) -> dict[str, str]:
    """The choices in the paper's vocabulary."""
    found = {part: IN_THE_PAPER.get((part, variant), variant) for part, variant in choices.items()}
    return consistent({part: variant for part, variant in found.items() if variant})


def beyond_the_paper(part: str, variant: str) -> bool:
    """True for a variant that the paper's vocabulary lacks."""
    return (part, variant) in IN_THE_PAPER


def apart(choices: Choices, others: Choices) -> list[str]:
    """Parts in which two choices differ."""
    return [part for part in PARTS if choices.get(part) != others.get(part)]
