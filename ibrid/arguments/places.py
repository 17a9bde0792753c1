"""What lies where a user says: files, records among them, and what is near where nothing lies."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from ibrid.errors import IbridError, near


def exists(text: str) -> bool:
    """Whether something lies at that path."""
    try:
        return bool(text) and Path(text).exists()
    except (OSError, ValueError):  # a name that is too long or holds a zero byte
        return False


def is_name(text: str, names: Iterable[str]) -> bool:
    """Whether a text is the name of what ships: no file lies there; a folder of that name, which
    is neither a program nor a sweep, does not hide it.
    """
    return text in names and (not exists(text) or Path(text).is_dir())


def require_file(text: str, names: Iterable[str], wanted: str, error: type[IbridError]) -> None:
    """Raise `error` unless there is something at the path `text`; names what lies near."""
    if exists(text):
        return
    path = Path(text)
    try:
        beside = [entry.name for entry in path.parent.iterdir()]
    except (OSError, ValueError):
        beside = []
    if path.name != text:  # a path: only its neighbours are meant
        raise error(
            f"{text[:200]!r} must be {wanted}; found nothing there, {_near_files(path, beside)}"
        )
    similar = get_close_matches(
        text, beside
    )  # what else lies in the folder is no program, or no sweep
    raise error(f"{text[:200]!r} must be {wanted}; found neither, {near(text, [*names, *similar])}")


def _near_files(path: Path, beside: list[str]) -> str:
    if not path.parent.is_dir():
        return f"there is no folder {path.parent}"
    return near(path.name, beside) if beside else f"the folder {path.parent} is empty"


def is_program_text(text: str) -> bool:
    """Whether a text is a program itself, not where one lies."""
    return "\n" in text or text.lstrip().startswith("def ")


def is_record(text: str) -> bool:
    """True for a file that holds a record."""
    if not exists(text):
        return False
    path = Path(text)
    return (
        path.is_file()
        and path.suffix.lower() == ".json"
        and '"ibrid.record/' in path.read_text("utf-8", "replace")
    )
