"""Shared libraries of exported C: for this platform by its compiler, for Windows by zig."""

import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
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
# contraction to fused operations would make the numbers depend on the processor; no build id, no
# path, no date
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared")


@dataclass(frozen=True)
class SharedLibrary:
    """`folder` : FMI's name of the platform.

    `suffix` : of its shared libraries. `content` : the file.
    """

    folder: str
    suffix: str
    content: bytes


#: What a compiler of this machine makes elsewhere: FMI's folder, the ending, the target in zig's
#: words.
WINDOWS = ("win64", ".dll", "x86_64-windows-gnu")


def shared_library(
    sources: Mapping[str, bytes], main: str, target: tuple[str, str, str] | None = None
) -> SharedLibrary:
    """Compile `main`, one of the named sources, which may include the others. target : None for
    this platform, or `WINDOWS`.

    Raises IbridError without a C compiler (for Windows: without the package ziglang), on a platform
    that FMI 2.0 has no name for, or where compiling fails.
    """
    if target is not None and sys.platform != "win32":
        folder, suffix, triple = target
        compiler, *more = _zig(triple)
    else:
        compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
        if compiler is None:
            raise IbridError(
                f"an FMU or a library needs a C compiler, found none of {', '.join(COMPILERS)}; "
                "install one (Debian: apt-get "
                "install gcc libc6-dev), or export c or modelica, which need none"
            )
        folder, suffix = fmi_platform()
        more = [] if sys.platform == "win32" else ["-fPIC"]
    with tempfile.TemporaryDirectory(prefix="ibrid-") as place:
        for name, content in sources.items():
            (Path(place) / name).write_bytes(content)
        command = [compiler, *more, *_OPTIONS, "-o", f"model{suffix}", main, "-lm"]
        done = subprocess.run(
            command, cwd=place, capture_output=True, text=True, errors="replace", check=False
        )
        library = Path(place) / f"model{suffix}"
        if done.returncode != 0 or not library.is_file():
            said = next(
                (line for line in done.stderr.splitlines() if "error" in line),
                done.stderr.strip()[:200],
            )
            raise IbridError(
                f"{compiler} must compile the exported model; it says: {said or done.returncode}"
            )
        return SharedLibrary(folder, suffix, library.read_bytes())


def _zig(triple: str) -> list[str]:
    """The compiler of the package ziglang, for another platform."""
    if find_spec("ziglang") is None:
        raise IbridError(
            "a library for Windows needs the package ziglang, which compiles for it here: pip "
            "install ziglang, or leave "
            "--windows out"
        )
    return [sys.executable, "-P", "-m", "ziglang", "cc", "-s", "-target", triple]


def fmi_platform() -> tuple[str, str]:
    """The folder of this platform in an FMU 2.0 and the ending of its shared libraries; IbridError
    without one.
    """
    bits = 64 if sys.maxsize > 2**32 else 32
    machine = platform.machine().lower()
    known = _PLATFORMS.get((sys.platform, bits))
    if known is None or (
        sys.platform == "linux" and machine not in ("x86_64", "amd64", "i386", "i686", "x86")
    ):
        raise IbridError(
            "FMI 2.0 has binaries for Linux and Windows on x86 and for macOS, found "
            f"{sys.platform} on {machine}; "
            "export on one of those, or export c or modelica"
        )
    return known
