"""A port file with branches, TOML: the collector network of a plant, as docs/predict.md shows one.

`[[element]]` from the PCC to the bus, as of a port; `[[branch]]` with `[[branch.element]]`, and a
device at its end or further `[[branch.branch]]`. Of a device `name`, `rating` over the base of
power (equal ones that make 1), `share` of what enters at its node (those of a node sum to 1;
without any by ratings), `values` that differ from the record's. `s_base_va`, `v_base_v`, `f0_hz`
for SI units.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ibrid.analysis.several_devices.collector import Collector
from ibrid.errors import SweepError
from ibrid.structure.network.port_file import (
    Bases,
    number_of,
    port_content,
    port_elements,
    require_known,
)

_PLANT = ("element", "branch", "s_base_va", "v_base_v", "f0_hz")
_BRANCH = ("name", "rating", "share", "values", "element", "branch")
#: Most devices of a plant, the largest rating of one over the base of power, and how far from a
#: share each branch may be.
MOST, LARGEST, WHOLE = 100, 100.0, 0.0051


class KnownBases(NamedTuple):
    """Bases that are known before a plant's file tells others."""

    s_base_va: float | None
    v_base_v: float | None
    f0_hz: float


def read_collector(path: str | Path, data: Bases) -> Collector:
    """The network of a plant, in a file as above; one without branches has one device behind its
    elements.

    data : what has the bases that the file does not tell. Raises SweepError, one sentence that says
    what to change.
    """
    where = f"the port {path}"
    content = port_content(path)
    require_known(content, _PLANT, where)
    bases = KnownBases(
        *(
            number_of(content, key, where, None) if key in content else getattr(data, key)
            for key in KnownBases._fields
        )
    )
    names: list[str] = ["all"]
    root = _branch(content, "", where, bases, names)
    devices = root.devices
    if len(devices) > MOST:
        raise SweepError(
            f"{where} has {len(devices)} devices; give at most {MOST}, one equivalent for each "
            "feeder"
        )
    rated = [one.rating > 0 for one in devices]
    if any(rated) != all(rated):
        raise SweepError(f"{where} gives a rating of some devices only; give it of all, or of none")
    return replace(_finished(root, 1.0 / len(devices)), bases=(bases.s_base_va, bases.v_base_v))


def _branch(
    entry: Mapping[str, Any], name: str, where: str, bases: Bases, names: list[str]
) -> Collector:
    """As written: a rating or a share of 0 stands for one that is not given. names : of the
    branches before it.
    """
    inner = entry.get("branch", [])
    if not isinstance(inner, list) or not all(isinstance(one, dict) for one in inner):
        raise SweepError(f"the branches of {where} must be tables; write [[branch]]")
    elements = port_elements(entry["element"], where, bases) if "element" in entry else ()
    branches = []
    for table in inner:
        own = table.get("name", f"{'node' if table.get('branch') else 'device'}_{len(names)}")
        there = f"branch {own!r:.40} of {where}"
        require_known(table, _BRANCH, there)
        if not isinstance(own, str) or not own.replace("-", "_").isidentifier():
            raise SweepError(f"the name of {there} must be of letters, digits, _ and -")
        if own in names:
            raise SweepError(f"{there} has a name that means another, or all devices; change it")
        names.append(own)
        rating, share = (number_of(table, key, there, 0.0) for key in ("rating", "share"))
        values = table.get("values", {})
        if not isinstance(values, dict):
            raise SweepError(
                f'the values of {there} must be a table such as {{"pll.kP_pll" = 30.0}}'
            )
        values = {key: number_of(values, key, f"the values of {there}", None) for key in values}
        if min(rating, share) < 0 or (table.get("branch") and (rating or values)):
            raise SweepError(
                f"rating, share and values of {there} must be of a device, and positive"
            )
        if rating > LARGEST:
            raise SweepError(
                f"the rating of {there} is {rating:g} times the base of power; give it per unit of "
                "it, not in VA"
            )
        branches.append(
            replace(
                _branch(table, own, there, bases, names), rating=rating, share=share, values=values
            )
        )
    return Collector(name, elements, tuple(branches), 0.0)


def _finished(branch: Collector, usual: float) -> Collector:
    """With ratings and shares."""
    if not branch.branches:
        return replace(branch, name=branch.name or "device_1", rating=branch.rating or usual)
    inner = [_finished(one, usual) for one in branch.branches]
    rating = sum(one.rating for one in inner)
    told = [one.share for one in inner]
    if not all(told):
        if any(told):
            raise SweepError(
                "the port gives a share of some branches of a node only; give it of all, or of none"
            )
        told = [one.rating / rating for one in inner]
    if abs(sum(told) - 1) > WHOLE * len(inner):
        raise SweepError(
            f"the shares of {' and '.join(one.name for one in inner)} of the port sum to "
            f"{sum(told):g}; of what enters at their "
            "node they must sum to 1, change them or leave them out"
        )
    inner = [replace(one, share=share / sum(told)) for one, share in zip(inner, told, strict=True)]
    return replace(branch, branches=tuple(inner), rating=rating)
