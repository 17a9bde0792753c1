"""Which files a model is made of beside its own: modules that it imports, libraries that it loads,
data that it reads.
"""

import os
import sys
import sysconfig
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

#: Where a POSIX system says which files a process has mapped.
_MAPS = Path("/proc/self/maps")
#: Folders of the system: what lies there belongs to no model.
_SYSTEM = ("/proc", "/sys", "/dev", "/etc", "/usr", "/lib", "/lib64", "/opt")


class FilesRead:
    """The files that this process reads from now on, those of Python and of the system apart."""

    def __init__(self) -> None:
        self._read: set[str] = set()
        self._written: set[str] = set()
        package = Path(__file__).resolve().parents[2]
        libraries = {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix, package}
        others = (tempfile.gettempdir(), *_SYSTEM)
        self._foreign = tuple(f"{Path(one).resolve()}{os.sep}" for one in (*libraries, *others))
        sys.addaudithook(self._note)

    def _note(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], str | bytes):
            return
        path, _, flags = arguments
        writes = flags & (os.O_WRONLY | os.O_RDWR)
        (self._written if writes else self._read).add(os.path.abspath(os.fsdecode(path)))

    def paths(self) -> list[str]:
        """Absolute paths of the regular files that were read, imported or loaded, sorted; those
        that the model wrote itself, such as its log, are left out.
        """
        modules = [getattr(module, "__file__", None) for module in [*sys.modules.values()]]
        mapped: list[str] = []
        with suppress(OSError):
            lines = _MAPS.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
            mapped = [line.split(maxsplit=5)[5] for line in lines if "/" in line]
        own_paths = set()
        for name in (*(self._read - self._written), *filter(None, modules), *mapped):
            with suppress(OSError, ValueError):
                path = Path(name).resolve()
                is_own = not str(path).startswith(self._foreign) and path.suffix != ".pyc"
                if is_own and path.is_file():
                    own_paths.add(str(path))
        return sorted(own_paths)
