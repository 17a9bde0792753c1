"""The floors of the house, read from its imports, and their picture for docs/architecture.md."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Distribution or part of one -> its folder. Rooms of ibrid are its folders and files.
PACKAGES = {
    "ibrid_search": ROOT / "search" / "ibrid_search",
    "ibrid_policy": ROOT / "search" / "policy" / "ibrid_policy",
    "ibrid_bench": ROOT / "search" / "ibrid_bench",
}
IBRID = ROOT / "ibrid"

_WIDTH, _ROW, _GAP, _SIDE = 720, 36, 8, 10
_STYLE = """<style>
rect { fill: #eef3f8; stroke: #7a93ac } .outside rect { fill: #f6efe3; stroke: #b49a6a }
text { font: 13px system-ui, sans-serif; fill: #1c2733; text-anchor: middle }
@media (prefers-color-scheme: dark) { rect { fill: #22303d; stroke: #6f8aa5 } .outside rect { fill: #3a3222; stroke: #a08a5c }
text { fill: #e6edf3 } }
</style>"""


def imported_modules(path: Path) -> list[tuple[int, str]]:
    """(line, dotted name) of every import in a file, those inside functions and of types
    included.
    """
    names: list[tuple[int, str]] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise ValueError(
                    f"{path} line {node.lineno}: imports name the owning module in full"
                )
            names.append((node.lineno, str(node.module)))
    return names


def room_of(module: str) -> str | None:
    """The room that a dotted name lies in; None outside the house."""
    first, *rest = module.split(".")
    if first == "ibrid":
        return rest[0] if rest else None
    return first if first in PACKAGES else None


def files_of(room: str) -> list[Path]:
    """The files of a room; programs of diagrams, which are read as text, are not among them."""
    if room in PACKAGES:
        found = PACKAGES[room].rglob("*.py")
    else:
        found = (IBRID / room).rglob("*.py") if (IBRID / room).is_dir() else [IBRID / f"{room}.py"]
    return sorted(path for path in found if "programs" not in path.parts)


def rooms() -> dict[str, frozenset[str]]:
    """Room -> the rooms that it imports."""
    own = {
        path.stem
        for path in IBRID.iterdir()
        if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    return {
        room: frozenset(
            found
            for path in files_of(room)
            for _, name in imported_modules(path)
            if (found := room_of(name)) not in (None, room)
        )
        for room in sorted((own - {"__init__", "__main__"}) | set(PACKAGES))
    }


def floors() -> tuple[tuple[str, ...], ...]:
    """Rooms by floor, the lowest first: each imports from floors below its own alone. Raises
    ValueError for a circle.
    """
    imports = rooms()

    @cache
    def level(room: str, above: tuple[str, ...] = ()) -> int:
        if room in above:
            raise ValueError(f"imports go in a circle: {' -> '.join((*above, room))}")
        return 1 + max((level(other, (*above, room)) for other in imports[room]), default=-1)

    levels = {room: level(room) for room in imports}
    return tuple(
        tuple(room for room in imports if levels[room] == one)
        for one in range(max(levels.values()) + 1)
    )


def architecture_svg() -> str:
    """The floors as a picture, the highest on top."""
    rows = floors()[::-1]
    height = len(rows) * (_ROW + _GAP) + _GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" role="img">',
        "<title>The rooms of ibrid by floor; a room imports from floors below its own "
        "alone</title>",
        _STYLE,
    ]
    for row, names in enumerate(rows):
        width = (_WIDTH - 2 * _SIDE - (len(names) - 1) * _GAP) / len(names)
        for column, name in enumerate(names):
            x, y = _SIDE + column * (width + _GAP), _GAP + row * (_ROW + _GAP)
            kind = ' class="outside"' if name in PACKAGES else ""
            parts.append(
                f'<g{kind}><rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{_ROW}" rx="6"/>'
                f'<text x="{x + width / 2:.1f}" y="{y + 23}">{name}</text></g>'
            )
    return "\n".join([*parts, "</svg>"])
