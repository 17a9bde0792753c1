"""A port file: the passive elements that are known between the PCC and the filter, TOML, in SI
units or per unit.
"""

from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import Any, Protocol

from ibrid.errors import SweepError, near
from ibrid.foreign_data import text_in, toml_in
from ibrid.ranges import LIMITS, finite_number, require_in_range
from ibrid.structure.network.outside import ELEMENTS, Outside, PortElement

_USUAL = {"R": 0.0, "ratio": 1.0}
#: Elements of a port or a branch at most: a fit takes a time that grows with them.
MOST_ELEMENTS = 50
_KEYS = ("kind", "unit", "tolerance", "v_base_v", "shift_deg")
#: Largest and smallest reactance or susceptance per unit that an element at a port may have.
PLAUSIBLE = (1e-7, 2.0)


class Bases(Protocol):
    """What has bases of power (VA) and voltage (V), None where unknown, and a nominal frequency: a
    sweep, records.
    """

    @property
    def s_base_va(self) -> float | None: ...
    @property
    def v_base_v(self) -> float | None: ...
    @property
    def f0_hz(self) -> float: ...


def read_port(path: str | Path, data: Bases) -> Outside:
    """The port of a sweep or of records of events, from the PCC inwards.

    `power_node = "outside" | "inside"`, where p and q were measured; `[[element]]` with `kind`
    (series R, L | shunt R, C | transformer R, L, ratio, shift_deg), values in ohm, H, F (`unit =
    "si"`) or per unit at f0 ("pu"), on the base voltage of the data or of `v_base_v` in the
    element; `tolerance`, one standard deviation of the logarithm.

    Raises SweepError, one sentence that says what to change, for anything else.
    """
    where = f"the port {path}"
    content = port_content(path)
    if "branch" in content:
        raise SweepError(
            f"{where} has branches, so several devices; `ibrid predict` and `ibrid drift` take it, "
            "and write with --equivalent "
            "the port of one device in their place"
        )
    require_known(content, ("power_node", "element"), where)
    node = content.get("power_node", "outside")
    if node not in ("outside", "inside"):
        raise SweepError(f'power_node of {where} must be "outside" or "inside", found {node!r:.40}')
    return Outside(port_elements(content.get("element", []), where, data), node == "inside")


def port_content(path: str | Path) -> dict[str, Any]:
    """What a port file holds, unchecked; SweepError where it is no TOML."""
    try:
        return toml_in(text_in(Path(path)))
    except OSError as error:
        raise SweepError(
            f"the port {path} cannot be read ({error.strerror}); give the path of a TOML file"
        ) from None
    except ValueError as error:
        raise SweepError(f"the port {path} is no TOML: {error}") from None


def port_elements(elements: Any, where: str, data: Bases) -> tuple[PortElement, ...]:
    """The elements of a port or of a branch, per unit."""
    if (
        not isinstance(elements, list)
        or not elements
        or not all(isinstance(one, dict) for one in elements)
    ):
        raise SweepError(
            f"{where} must have elements; write [[element]] with kind, values and unit"
        )
    if len(elements) > MOST_ELEMENTS:
        raise SweepError(
            f"{where} must have at most {MOST_ELEMENTS} elements, found {len(elements)}; join "
            "those in series"
        )
    named = [(f"element {number} of {where}", one) for number, one in enumerate(elements, start=1)]
    return tuple(_element(one, name, data) for name, one in named)


def _element(entry: Mapping[str, Any], where: str, data: Bases) -> PortElement:
    kind = str(entry.get("kind"))
    if kind not in ELEMENTS:
        raise SweepError(
            f"{where} must be one of {', '.join(ELEMENTS)}, found {kind!r:.40}; "
            f"{near(kind, ELEMENTS)}"
        )
    require_known(entry, (*_KEYS, *ELEMENTS[kind]), where)
    tolerance = number_of(entry, "tolerance", where, 0.0)
    unit = entry.get("unit")
    if unit not in ("si", "pu"):
        raise SweepError(
            f'{where} must have unit = "si" or "pu", found {unit!r:.40}; ohm, H and F are "si"'
        )
    scale = _per_unit(entry, where, data, unit)
    values = {
        name: number_of(entry, name, where, _USUAL.get(name)) * scale.get(name, 1.0)
        for name in ELEMENTS[kind]
    }
    number_of(entry, "shift_deg", where, 0.0)
    for name, value in values.items():
        least, most = PLAUSIBLE
        if value < 0 or value > 1e4 or (name in "LC" and not least <= value <= most):
            raise SweepError(
                f"{name} of {where} is {value:.3g} per unit, which no port has; see that its unit "
                f"is {unit!r}"
                + (" (ohm, H, F)" if unit == "si" else " (per unit at f0)")
                + " and that v_base_v and s_base_va are right"
            )
    return PortElement(kind, values, tolerance)


def _per_unit(entry: Mapping[str, Any], where: str, data: Bases, unit: str) -> dict[str, float]:
    """Factors from the element's unit to per unit of the sweep's base, name by name."""
    voltage = data.v_base_v or 0.0
    if "v_base_v" in entry:
        voltage = number_of(entry, "v_base_v", where, None)
    if unit == "pu":
        return {}
    if not voltage > 0 or data.s_base_va is None:
        raise SweepError(
            f"{where} is in SI units, which need s_base_va and v_base_v; write them at the top of "
            "the data, or of a port file "
            'with branches, or use unit = "pu"'
        )
    base = voltage**2 / data.s_base_va
    return {"R": 1 / base, "L": 2 * pi * data.f0_hz / base, "C": 2 * pi * data.f0_hz * base}


def number_of(entry: Mapping[str, Any], name: str, where: str, usual: float | None) -> float:
    """A finite number of an entry; SweepError for anything else."""
    value = entry.get(name, usual)
    if (number := finite_number(value)) is None:
        raise SweepError(
            f"{name} of {where} must be a number, found "
            f"{'nothing' if value is None else repr(value)[:40]}"
        )
    if name in LIMITS:
        require_in_range(name, number, f"{name} of {where}")
    return number


def require_known(entry: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """SweepError for the first key that is not known."""
    if unknown := [key for key in entry if key not in known]:
        raise SweepError(f"{where} has {unknown[0]!r:.40}; {near(unknown[0], known)}")
