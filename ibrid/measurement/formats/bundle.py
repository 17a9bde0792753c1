"""Files that are compressed, and archives of files: `scans.zip/full.csv` is a path like any other,
`sweep.csv.gz` a csv.
"""

import bz2
import io
import lzma
import os.path
import re
import tarfile
import zipfile
import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from ibrid.errors import SweepError
from ibrid.own_files import announce

#: Bytes of a file once it is unpacked, and files of an archive, at most.
LARGEST, MOST_FILES = 200_000_000, 1_000
#: Bytes that are unpacked at a time, and of memory that one file may ask for.
_PIECE, _MEMORY = 1 << 20, 256 << 20
#: How compressed files begin.
_PACKERS = {b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh": "bzip2"}
PACKED = tuple(_PACKERS)
#: Endings of the name of a file that only say how it is compressed.
ENDINGS = (".gz", ".xz", ".bz2")
_ARCHIVE = re.compile(r".*\.(zip|tar|tgz|tar\.(gz|xz|bz2))", re.IGNORECASE)
#: Files of an archive that hold no numbers.
_BESIDE = (
    ".meta",
    ".md",
    ".pdf",
    ".png",
    ".jpg",
    ".svg",
    ".html",
    ".htm",
    ".hdr",
    ".doc",
    ".docx",
    ".py",
    ".m",
)


def suffix_of(path: Path) -> str:
    """The ending of a file's name in small letters; of `sweep.csv.gz` it is .csv."""
    return _unpacked_name(path).suffix.lower()


def stem_of(path: Path) -> str:
    """The name of a file without its endings."""
    return _unpacked_name(path).stem


def is_archive(path: Path) -> bool:
    """Whether a path is that of an archive of files."""
    return _ARCHIVE.fullmatch(path.name) is not None and path.is_file()


def files_in(path: Path) -> list[Path]:
    """The files with numbers in an archive, in its order; of any other path itself.

    SweepError for an archive that is none.
    """
    if not is_archive(path):
        return [path]
    with _opened(path) as archive:
        names = [one.filename for one in archive.infolist() if not one.is_dir()]
    names = [name for name in names if _is_data(Path(name))]
    if not names:
        raise SweepError(
            f"{path} must hold files with numbers; found none, name the files themselves."
        )
    if len(names) > MOST_FILES:
        raise SweepError(
            f"{path} must hold at most {MOST_FILES} files; found {len(names)}, unpack it and name "
            "some."
        )
    return [path / name for name in names]


def is_there(path: Path) -> bool:
    """Whether there is a file at a path, which may lie in an archive."""
    archive, name = _in_archive(path)
    if archive is None:
        return os.path.exists(path)  # False too where the system refuses to say
    with _opened(archive) as held:
        return name in held.namelist()


def beside(path: Path) -> list[Path]:
    """The files in the folder, or in the archive, in which a file lies; itself among them."""
    archive, _ = _in_archive(path)
    if archive is None:
        return sorted(path.parent.iterdir()) if path.parent.is_dir() else []
    with _opened(archive) as held:
        return [one for name in held.namelist() if (one := archive / name).parent == path.parent]


def member(path: Path) -> bytes | None:
    """The content of a file of an archive; None for a path that does not lead into one."""
    archive, name = _in_archive(path)
    if archive is None:
        return None
    with _opened(archive) as held:
        if name not in held.namelist():
            raise SweepError(f"{path} must exist; {archive.name} holds no such file.")
        try:
            with held.open(name) as stream:
                content = stream.read(LARGEST + 1)
        except (RuntimeError, NotImplementedError) as reason:
            raise SweepError(
                f"{path} must be readable; {reason}, unpack the archive yourself."
            ) from None
        except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError):
            raise SweepError(
                f"{path} must be readable; the archive is damaged, save it again."
            ) from None
    _require_size(path, len(content))
    return content


def unpacked(content: bytes, path: Path) -> bytes:
    """The content of a file that may be compressed.

    SweepError: it is damaged, or too large once it is unpacked.
    """
    how = next((name for begin, name in _PACKERS.items() if content.startswith(begin)), "")
    if not how:
        return content
    try:
        return _unpacked(content, how, path)
    except (zlib.error, lzma.LZMAError, OSError, EOFError, ValueError):
        raise SweepError(
            f"{path} must be readable; it begins as {how} and is damaged or cut off, save it again."
        ) from None


def _unpacked(content: bytes, how: str, path: Path) -> bytes:
    """Streams behind each other are one; zeros behind them fill a block."""
    pieces, size, rest = [], 0, content
    while rest.rstrip(b"\0"):
        stream = _STREAMS[how]()
        while not stream.eof:
            piece = stream.decompress(rest, _PIECE)
            rest = stream.unconsumed_tail if how == "gzip" else b""
            if not piece and not stream.eof and (how == "gzip" or stream.needs_input):
                raise EOFError
            pieces.append(piece)
            size += len(piece)
            _require_size(path, size)
        rest = stream.unused_data
    return b"".join(pieces)


_STREAMS: dict[str, Callable] = {
    "gzip": lambda: zlib.decompressobj(zlib.MAX_WBITS | 16),
    "xz": lambda: lzma.LZMADecompressor(lzma.FORMAT_XZ, _MEMORY),
    "bzip2": bz2.BZ2Decompressor,
}


def _require_size(path: Path, size: int) -> None:
    if size > LARGEST:
        raise SweepError(
            f"{path} must be at most {LARGEST // 10**6} MB once it is unpacked; found more, keep "
            "one record or one sweep."
        )


def _unpacked_name(path: Path) -> Path:
    return (
        Path(path.name[: -len(path.suffix)]) if path.suffix.lower() in ENDINGS else Path(path.name)
    )


def _is_data(name: Path) -> bool:
    hidden = any(part.startswith((".", "__MACOSX")) for part in name.parts)
    return (
        not hidden
        and name.suffix.lower() not in _BESIDE
        and name.stem.lower() not in ("readme", "license", "liesmich")
    )


def _in_archive(path: Path) -> tuple[Path | None, str]:
    """The archive in which a path lies, and its name there."""
    for folder in path.parents:
        if _ARCHIVE.fullmatch(folder.name) and os.path.isfile(folder):
            return folder, path.relative_to(folder).as_posix()
    return None, ""


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        if path.stat().st_size > LARGEST:
            raise SweepError(
                f"{path} must be at most {LARGEST // 10**6} MB; unpack it and name one file."
            )
        announce(path)
        if path.suffix.lower() != ".zip":
            return zipfile.ZipFile(io.BytesIO(_zipped(path, path.stat().st_mtime_ns)))
        return zipfile.ZipFile(io.BytesIO(path.read_bytes()))
    except (zipfile.BadZipFile, tarfile.TarError, OSError, ValueError, NotImplementedError):
        raise SweepError(
            f"{path} must be a {path.suffix.lower()[1:]} archive; it cannot be read, save it again."
        ) from None


@lru_cache(1)
def _zipped(path: Path, changed: int) -> bytes:
    """The regular files of a tar archive, which may be compressed, as a zip archive."""
    zipped = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(unpacked(path.read_bytes(), path)), mode="r:") as packed,
        zipfile.ZipFile(zipped, "w") as archive,
    ):
        files = {one.name.removeprefix("./"): one for one in packed.getmembers() if one.isreg()}
        _require_size(path, sum(one.size for one in files.values()))
        for name, one in files.items():
            if not name:
                raise ValueError("a file without a name")
            archive.writestr(name, packed.extractfile(one).read())  # pyright: ignore
    return zipped.getvalue()
