"""run.toml: the options and versions a run was made with; a resumed run must agree with it."""

import hashlib
import math
import tomllib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from typing import Any

from ibrid.errors import IbridError

#: Packages whose versions can change a number.
_PACKAGES = ("ibrid", "casadi", "control", "numba", "numpy", "peft", "scipy", "torch", "transformers")
#: Options that may differ when a run is resumed.
FREE = ("budget", "target", "workers", "ray", "prices", "settings.wall")
_DIGEST = "_sha256"


def run_toml(options: Mapping[str, Any]) -> str:
    """The text of run.toml: options (tables for mappings), then versions."""
    plain = {key: value for key, value in options.items() if not isinstance(value, Mapping)}
    tables = {key: value for key, value in options.items() if isinstance(value, Mapping)}
    lines = [f"{key} = {_value(value)}" for key, value in plain.items() if value is not None]
    for name, table in {**tables, "versions": _versions()}.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_value(value)}" for key, value in table.items() if value is not None]
    return "\n".join(lines) + "\n"


def read_run_toml(text: str, where: str) -> dict[str, Any]:
    """The options; IbridError when the text is not TOML."""
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise IbridError(f"{where}: must be TOML, but {error}; restore it, or start a new run") from None


def require_same(before: Mapping[str, Any], now: Mapping[str, Any], where: str) -> None:
    """Raise IbridError when options that shape the search differ from those of the run; the same data may lie elsewhere."""
    made, wanted = _flat(before), _flat(read_run_toml(run_toml(now), "the options"))
    moved = made.get("data_sha256") == wanted.get("data_sha256") is not None
    for name in sorted((set(made) | set(wanted)) - {*FREE, *(["data"] if moved else [])}):
        if made.get(name) != wanted.get(name):
            what = f"{name} = {_shown(made.get(name))}, now it is {_shown(wanted.get(name))}"
            if name.endswith(_DIGEST):
                what = f"{name.removesuffix(_DIGEST)} of other content"
            raise IbridError(f"{where}: the run was made with {what}; resume with the same, or choose another folder")


def digest(content: str | bytes) -> str:
    """What stands for a text or a file among the options, under a name that ends in _sha256."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[:32]


def _flat(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options by name, those of a table as "table.name"; without the versions."""
    found: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Mapping) and name != "versions":
            found |= {f"{name}.{key}": inner for key, inner in value.items()}
        elif name != "versions":
            found[name] = value
    return found


def _shown(value: Any) -> str:
    return "nothing" if value is None else f"{value!s:.120}"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ("nan" if math.isnan(value) else "inf" if value > 0 else "-inf")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return '"' + "".join(_escaped(one) for one in str(value)) + '"'


def _escaped(character: str) -> str:
    """In a TOML text; half a surrogate pair, as in the name of a file that is no text, becomes a question mark."""
    if character in '"\\':
        return "\\" + character
    if "\ud800" <= character <= "\udfff":
        return "?"
    return character if character.isprintable() else f"\\U{ord(character):08x}"


def _versions() -> dict[str, str]:
    found = {"python": python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
