"""Files in and out: what can go wrong on disk becomes one sentence, and a file is replaced whole or
not at all.
"""

import contextlib
import os.path
import re
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ibrid.errors import IbridError, SweepError
from ibrid.measurement.formats import bundle
from ibrid.measurement.formats.no_numbers import refuse_without_numbers
from ibrid.own_files import announce
from ibrid.writing import write_whole

MAX_BYTES = bundle.LARGEST
#: Bytes of a file that show how it begins.
BEGINNING = 1 << 16
#: Encodings in the order tried -> pattern that the decoded text must contain: words of tables
#: where bytes alone do not tell, kana of Japanese, two characters of Chinese beside each other, as
#: one may be two letters of another language (Größe).
_WRITTEN = {
    "utf-8-sig": "",
    "cp949": "주파수|실수|허수|실부|허부|전압|전류|시간|위상|크기",
    "cp932": "時間|周波数|電圧|電流|実部|虚部|実数|虚数|位相|[\u3041-\u30fa]{2}",
    "gb2312": "[\u4e00-\u9fff]{2}",
    "gb18030": "频率|電壓|電流|頻率|电压|电流|时间|实部|虚部|有功|无功|导纳|阻抗|幅值|相角|相位",
    "cp1252": "",
}
LONGEST_LINE = 20_000


def read_bytes(path: Path) -> bytes:
    """The content of a regular file of at most 200 MB, unpacked where it is compressed or lies in
    an archive.

    Raises SweepError, which says why it cannot be had; a picture or a document holds no numbers.
    """
    content = _unpacked_bytes(path)
    refuse_without_numbers(content, str(path))
    return content


def _unpacked_bytes(path: Path) -> bytes:
    """The content, whatever it is."""
    if not os.path.exists(path) and (content := bundle.member(path)) is not None:
        return bundle.unpacked(content, path)
    try:
        if path.is_dir():
            raise SweepError(
                f"{path} must be a file; found a folder, name one of the files in it"
                f"{_all_of(path)}."
            )
        if not path.exists():
            raise SweepError(f"{path} must exist; found nothing there, check the path.")
        if not path.is_file():
            raise SweepError(
                f"{path} must be a regular file; found a device or pipe, save the data to a file "
                "first."
            )
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise SweepError(
                f"{path} must be at most {MAX_BYTES // 10**6} MB; found {size / 1e6:.0f} MB, "
                "keep one sweep per file and leave out what is not admittance."
            )
        announce(path)
        content = path.read_bytes()
        if b"\0" in content[:BEGINNING] and bundle.is_archive(path):
            raise SweepError(
                f"{path} must be one file; found an archive, name a file in it: "
                f"{bundle.files_in(path)[0]}, or use ibrid import."
            )
        return bundle.unpacked(content, path) if content.startswith(bundle.PACKED) else content
    except (OSError, ValueError) as reason:
        raise SweepError(
            f"{str(path)!r} must be readable; {getattr(reason, 'strerror', None) or reason}."
        ) from reason


def _all_of(folder: Path) -> str:
    """The command that reads the files of a folder which end as most of them do; "" of none."""
    names = sorted(one.name for one in folder.iterdir() if one.is_file() and one.name[0] != ".")
    endings = Counter(Path(name).suffix for name in names if not name.endswith(".meta"))
    if not endings:
        return ""
    ending = endings.most_common(1)[0][0]
    return f", or all at once: ibrid import {shlex.quote(str(folder))}/*{ending} --out read.csv"


def read_lines(path: Path) -> list[str]:
    """The lines of a UTF-8 text file, without line ends; SweepError when it is not text or has
    nothing in it.
    """
    return text_lines(read_bytes(path), str(path))


def head_lines(path: Path) -> list[str]:
    """The lines with which a text file begins, whatever its encoding; the last may be left out.

    Raises SweepError as `read_bytes`.
    """
    content = _beginning(path)
    if len(content) == BEGINNING:
        content = content[: content.rfind(b"\n") + 1] or content
    return decoded(content).splitlines()


def decoded(content: bytes) -> str:
    """Text of any encoding, of those of countries the first in whose letters words are written."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    for encoding, words in _WRITTEN.items():
        with contextlib.suppress(UnicodeDecodeError):
            if re.search(words, text := content.decode(encoding)):
                return text
    return content.decode("latin-1")


def _beginning(path: Path) -> bytes:
    """The first bytes of a file; of one that is compressed or lies in an archive, of what it
    holds.
    """
    if path.is_file():
        with open(path, "rb") as stream:
            content = stream.read(BEGINNING)
        if not content.startswith(bundle.PACKED):
            return content
    return read_bytes(path)[:BEGINNING]


def first_line(path: Path) -> str:
    """The first line that is neither empty nor a comment."""
    lines = map(str.strip, read_bytes(path).decode("utf-8-sig", errors="replace").splitlines())
    return next((line for line in lines if line and not line.startswith("#")), "")


def text_lines(content: bytes, where: str) -> list[str]:
    """The lines of UTF-8 text; `where` names the file in errors."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        line = content.count(b"\n", 0, reason.start) + 1
        raise SweepError(
            f"{where} must be UTF-8 text; line {line} holds other bytes, export it as text (CSV "
            "UTF-8)."
        ) from reason
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise SweepError(
            f"{where} must be UTF-8 text; line {line} holds a zero byte, export it as text (CSV "
            "UTF-8)."
        )
    if not text.strip():
        raise SweepError(f"{where} must hold a sweep or records of events; found an empty file.")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    require_short_lines(lines, where)
    return lines


def require_short_lines(lines: Sequence[str], where: str) -> None:
    """SweepError for a line that is longer than any table's."""
    if (longest := max(map(len, lines))) > LONGEST_LINE:
        line = next(number for number, line in enumerate(lines, 1) if len(line) == longest)
        raise SweepError(
            f"{where} must have lines of at most {LONGEST_LINE} characters; line {line} has "
            f"{longest}, put one frequency "
            "on a line."
        )


def write_atomically(path: Path, text: str) -> None:
    """Write text beside `path` and move it there, so that a reader sees the old file or the new
    one, never half.

    Raises SweepError when the folder does not exist or cannot be written.
    """
    try:
        write_whole(path, text)
    except IbridError as error:
        raise SweepError(str(error)) from None
