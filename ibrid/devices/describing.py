"""What a model file offers, and a DEVICE.toml to correct: `ibrid measure FILE --describe`."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

import tomli_w

from ibrid.devices.device_file import REFERENCES
from ibrid.errors import IbridError


@dataclass(frozen=True)
class Description:
    """`lines` : what the file offers. `device` : what its DEVICE.toml may hold. `doubts` : what in it is guessed, or missing."""

    lines: Sequence[str]
    device: Mapping[str, Any]
    doubts: Sequence[str]

    @property
    def text(self) -> str:
        """As the command prints it: comments, then the DEVICE.toml."""
        comments = [f"# {line}".rstrip() for line in (*self.lines, "", *self.doubts)]
        return "\n".join(comments) + "\n" + tomli_w.dumps(dict(self.device))


def describe_here(file: str) -> dict[str, Any]:
    """What a model file offers, in the types of JSON; its code runs in this process.

    Raises IbridError for a file that is no model.
    """
    path = Path(file)
    if path.suffix == ".py":
        return vars(_of_python(path))
    raise IbridError(f"{file}: is no model file; --describe takes a .py")


def _of_python(path: Path) -> Description:
    from ibrid.devices.python_device import devices_in, module_in

    module = module_in(path.absolute())
    names = devices_in(module)
    if not names:
        raise IbridError(
            f"{path}: nothing in it has step(t, v_abc); give an object or a class this method, which answers three currents"
        )
    lines = [f"{path.name}: has step(t, v_abc) in {', '.join(names)}"]
    chosen = getattr(module, names[-1])
    parameters = _numbers_of(chosen) if isinstance(chosen, type) else {}
    if isinstance(chosen, type):
        with suppress(Exception):  # it needs arguments, or anything else that only its user knows
            chosen = chosen()
    lines += [f"  {names[-1]} takes {name} = {value}" for name, value in parameters.items()]
    known = [role for role in REFERENCES if hasattr(chosen, role)]
    signals: dict[str, Any] = {"v": {"unit": "pu"}, "i": {"unit": "pu", "sign": 1}}
    signals |= {role: {"name": role, "unit": "pu"} for role in known}
    device = {"kind": "python", "file": f"{path.name}:{names[-1]}", "step_s": 1e-4, "f0_hz": 50.0, "signals": signals}
    doubts = [
        'guessed: step_s, f0_hz and every unit; in V and A write unit = "V", unit = "A" and s_base_va, v_base_v at the top',
        "sign of i: 1 where step answers the current out of the device, -1 where it answers that into it",
        *([] if known else ["no attribute p_ref, q_ref, v_ref or f_ref was found: name its references in [signals]"]),
    ]
    return Description(lines, device | ({"parameters": parameters} if parameters else {}), doubts)


def _numbers_of(made: type) -> dict[str, float | str]:
    """The arguments of a class that have a number or a text as default."""
    try:
        arguments = signature(made).parameters.values()
    except (ValueError, TypeError):
        return {}
    given = {one.name: one.default for one in arguments if one.default is not Parameter.empty}
    return {name: value for name, value in given.items() if isinstance(value, int | float | str)}
