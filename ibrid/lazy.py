"""Public names of a package that are imported when they are first used: those that its `if TYPE_CHECKING` block imports."""

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module


@cache
def homes(package: str) -> dict[str, str]:
    """Public name -> module, as the package's own source tells it to those who read types."""
    import ast  # `import ibrid` costs nothing
    import inspect

    block = next(node for node in ast.parse(inspect.getsource(sys.modules[package])).body if isinstance(node, ast.If))
    imports = (node for node in block.body if isinstance(node, ast.ImportFrom))
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def imported_by_need(package: str) -> Callable[[str], object]:
    """The `__getattr__` of a package. No module may have a public name: importing it would put it in the name's place."""

    def attribute(name: str) -> object:
        if name.startswith("__") or name not in homes(package):
            raise AttributeError(f"{package} has no {name}")
        return getattr(import_module(homes(package)[name]), name)

    return attribute
