"""C sources compiled to a shared library with the compiler of this machine."""

import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ibrid.errors import IbridError

COMPILERS = ("cc", "gcc", "clang")

#: (system, bits) -> the folder that FMI 2.0 gives it, and the ending of its shared libraries.
_PLATFORMS = {
    ("linux", 64): ("linux64", ".so"),
    ("linux", 32): ("linux32", ".so"),
    ("darwin", 64): ("darwin64", ".dylib"),
    ("win32", 64): ("win64", ".dll"),
    ("win32", 32): ("win32", ".dll"),
}
# contraction to fused operations would make the numbers depend on the processor; no build id, no path, no date
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared")


@dataclass(frozen=True)
class SharedLibrary:
    """`folder` : FMI's name of the platform. `suffix` : of its shared libraries. `content` : the file."""

    folder: str
    suffix: str
    content: bytes


def shared_library(sources: Mapping[str, bytes], main: str) -> SharedLibrary:
    """Compile `main`, one of the named sources, which may include the others.

    Raises IbridError without a C compiler, on a platform that FMI 2.0 has no name for, or where compiling fails.
    """
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise IbridError(
            f"an FMU needs a C compiler, found none of {', '.join(COMPILERS)}; install one (Debian: apt-get install gcc "
            "libc6-dev), or export c or modelica, which need none"
        )
    folder, suffix = fmi_platform()
    portable = () if sys.platform == "win32" else ("-fPIC",)
    with tempfile.TemporaryDirectory(prefix="ibrid-") as place:
        for name, content in sources.items():
            (Path(place) / name).write_bytes(content)
        command = [compiler, *_OPTIONS, *portable, "-o", f"model{suffix}", main, "-lm"]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, errors="replace", check=False)
        library = Path(place) / f"model{suffix}"
        if done.returncode != 0 or not library.is_file():
            said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
            raise IbridError(f"{compiler} must compile the exported model; it says: {said or done.returncode}")
        return SharedLibrary(folder, suffix, library.read_bytes())


def fmi_platform() -> tuple[str, str]:
    """The folder of this platform in an FMU 2.0 and the ending of its shared libraries; IbridError without one."""
    bits = 64 if sys.maxsize > 2**32 else 32
    machine = platform.machine().lower()
    known = _PLATFORMS.get((sys.platform, bits))
    if known is None or (sys.platform == "linux" and machine not in ("x86_64", "amd64", "i386", "i686", "x86")):
        raise IbridError(
            f"FMI 2.0 has binaries for Linux and Windows on x86 and for macOS, found {sys.platform} on {machine}; "
            "export on one of those, or export c or modelica"
        )
    return known
