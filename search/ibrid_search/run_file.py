"""run.toml: the options and versions a run was made with; a resumed run must agree with it."""

import hashlib
import tomllib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from typing import Any

import tomli_w

from ibrid.errors import IbridError

#: Packages whose versions can change a number.
_PACKAGES = ("ibrid", "casadi", "control", "numba", "numpy", "peft", "scipy", "torch", "transformers")
#: Options that may differ when a run is resumed.
FREE = ("budget", "target", "workers", "ray", "prices", "settings.wall")
_DIGEST = "_sha256"


def run_toml(options: Mapping[str, Any]) -> str:
    """The text of run.toml: options (tables for mappings), then versions."""
    return tomli_w.dumps(_plain({**options, "versions": _versions()}))


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


def _plain(value: Any) -> Any:
    """In the types of TOML; None is left out, and half a surrogate pair (a file name that is no text) becomes "?"."""
    if isinstance(value, Mapping):
        return {_plain(str(key)): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value if isinstance(value, bool | int | float) else str(value).encode(errors="replace").decode()


def _versions() -> dict[str, str]:
    found = {"python": python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
