"""Whether an answer names what is hidden: first, within its class, both of two."""

from collections.abc import Mapping
from itertools import permutations
from typing import Any

from ibrid.errors import IbridError
from ibrid.structure.comparison.compare import compare
from ibrid.structure.diagrams.program import parse_program

FRAME = "frame_misalignment"


def naming(truth: Mapping[str, Any], gap: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the names in an answer; None where the question does not arise.

    `named_first` : the first effect is a hidden one, with its change (a replacement may be called
    an addition), or the repaired program is the device itself under another name. `inside_class` :
    a hidden effect is the first one or among those that it cannot be told from. `class_size` : of
    the first one. `all_named` : of two, each in the class of an effect of its own. `extra` :
    effects answered beyond those hidden.
    """
    hidden, effects = truth["effects"], gap.get("effects", [])
    several = len(hidden) > 1
    found: dict[str, Any] = dict.fromkeys(
        ("named_first", "inside_class", "class_size", "all_named", "extra")
    )
    if not has_a_name(truth):
        return found
    found |= {"named_first": False, "inside_class": False, "all_named": False if several else None}
    found["extra"] = max(0, len(effects) - len(hidden))
    if gap.get("verdict") not in truth["verdicts"] or not effects:
        return found
    ids = [one["id"] for one in hidden]
    classes = [{one["id"], *one.get("indistinguishable_from", ())} for one in effects]
    device = is_the_device(gap, truth)
    found["named_first"] = device or any(_same(effects[0], one) for one in hidden)
    found["inside_class"] = device or any(one in classes[0] for one in ids)
    found["class_size"] = len(classes[0])
    if several:
        orders = permutations(classes, len(ids))
        found["all_named"] = device or any(
            all(map(set.__contains__, order, ids)) for order in orders
        )
    return found


def has_a_name(truth: Mapping[str, Any]) -> bool:
    """Whether the right answer names an effect: one of the catalogue is hidden that is no matter of
    parameters.
    """
    return truth["verdicts"][0] == "named" or FRAME in [one["id"] for one in truth["effects"]]


def is_the_device(gap: Mapping[str, Any], truth: Mapping[str, Any]) -> bool:
    """Whether the repaired program has the structure of the device: two effects that make the same
    edit are one.
    """
    if truth["device"] is None or gap["verdict"] != "named":
        return False
    try:
        return compare(
            parse_program(gap["program"]), parse_program(truth["device"]["program"])
        ).same
    except IbridError:
        return False


def _same(effect: Mapping[str, Any], hidden: Mapping[str, Any]) -> bool:
    return effect["id"] == hidden["id"] and (
        hidden["change"] == "replace" or effect["change"] == hidden["change"]
    )
