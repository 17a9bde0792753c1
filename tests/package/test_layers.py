"""Imports go one way: a file of the package imports only from layers below its own, wherever in the
file it does so.
"""

import re
from pathlib import Path

import networkx as nx
import pytest
from collecting import each_of
from floors import imported_modules

PACKAGE = Path(__file__).resolve().parents[2] / "ibrid"
#: Lowest first. `demo` is a program on top, like the command line.
LAYERS = (
    ("foreign_text", "interrupts"),
    ("errors", "lazy", "frozen", "foreign_data"),
    ("streams", "showing"),
    ("border", "signals", "own_files", "display", "ranges"),
    ("schemas",),
    ("writing",),
    ("telling", "hanging"),
    ("measurement",),
    ("modules",),
    ("structure",),
    ("parts",),
    ("assembly",),
    ("fit",),
    ("study",),
    ("evaluation",),
    ("plants",),
    ("arguments",),
    ("playback",),
    ("generic",),
    ("devices",),
    ("gap",),
    ("plugins",),
    ("analysis",),
    ("export",),
    ("report",),
    ("testing", "commands"),
    ("cli", "demo"),
    ("__main__",),
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
FILES = sorted(path for path in PACKAGE.rglob("*.py") if "programs" not in path.parts)


#: A kind asks what it does, and is asked by that.
KNOWN_CIRCLES = {
    f"ibrid.modules.{one}" for one in ("behaviour", "declaration", "kind", "large_signal")
}


def name_of(path: Path) -> str:
    """The module of a file of `ibrid` or `ibrid_search`."""
    root = PACKAGE.parent if path.is_relative_to(PACKAGE) else PACKAGE.parent / "search"
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def layer_of(path: Path) -> str:
    """The part of the package that a file belongs to."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def test_every_part_of_the_package_has_its_place_in_the_order():
    parts = {layer_of(path) for path in FILES} - {"__init__"}
    assert parts <= set(LEVEL), f"say where {sorted(parts - set(LEVEL))} belongs"


#: The two public names that come from the search, imported by need: where they are, and from where.
BY_NEED = (("__init__", "ibrid_search.running"), ("testing", "ibrid_search.testing"))


@pytest.mark.slow
@each_of("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_file_imports_only_from_layers_below(path: Path):
    own = layer_of(path)
    for line, name in imported_modules(path):
        where = f"{path.relative_to(PACKAGE)} line {line}: {name}"
        first, *rest = name.split(".")
        outside = ("ibrid_search", "ibrid_policy", "ibrid_bench")
        assert first not in outside or (own, name) in BY_NEED, (
            f"{where}: ibrid never imports the search"
        )
        if first == "matplotlib":
            assert own == "report", f"{where}: pictures are made in ibrid/report"
        if first != "ibrid" or own == "__init__":
            continue
        if not rest:
            assert own in ("cli", "demo"), (
                f"{where}: import the owning module, not the root package"
            )
            continue
        assert rest[0] == own or LEVEL[rest[0]] < LEVEL[own], f"{where}: {own} lies below {rest[0]}"


def test_no_files_import_one_another_in_a_circle():
    """Imports within functions and for types are counted; the two circles that are left are
    known.
    """
    search = PACKAGE.parent / "search" / "ibrid_search"
    paths = {name_of(path): path for folder in (PACKAGE, search) for path in folder.rglob("*.py")}
    graph = nx.DiGraph()
    for name, path in paths.items():
        for _, imported in imported_modules(path):
            known = imported if imported in paths else imported.rpartition(".")[0]
            if known in paths and known != name and path.name != "__init__.py":
                graph.add_edge(name, known)
    circles = [circle for circle in nx.strongly_connected_components(graph) if len(circle) > 1]
    assert {one for circle in circles for one in circle} <= KNOWN_CIRCLES


#: Packages of rooms, folders of files about one thing; their own files are rooms, too.
OF_ROOMS = (
    "ibrid/measurement",
    "ibrid/structure",
    "ibrid/parts",
    "ibrid/gap",
    "ibrid/analysis",
    "ibrid/report",
    "search/ibrid_search",
)
#: Files of a folder at most. Programs and published diagrams are data.
MOST_FILES = 21


@each_of("package", OF_ROOMS)
def test_rooms_import_one_way(package: str):
    folder = PACKAGE.parent / package
    graph, own_name = nx.DiGraph(), package.removeprefix("search/").replace("/", ".")
    for path in (one for one in folder.rglob("*.py") if one != folder / "__init__.py"):
        room = path.relative_to(folder).with_suffix("").parts[0]
        for _, imported in imported_modules(path):
            other = imported.removeprefix(f"{own_name}.").split(".")[0]
            if imported.startswith(f"{own_name}.") and other != room:
                graph.add_edge(room, other)
    assert not [
        sorted(circle) for circle in nx.strongly_connected_components(graph) if len(circle) > 1
    ]


def test_no_folder_is_a_long_list_and_each_says_what_is_inside():
    search = PACKAGE.parent / "search" / "ibrid_search"
    for folder in sorted(
        {path.parent for root in (PACKAGE, search) for path in root.rglob("*.py")}
    ):
        files = sorted(folder.glob("*.py"))
        if folder.name in ("programs", "published"):
            continue
        assert len(files) <= MOST_FILES + (folder == PACKAGE), f"{folder} has {len(files)} files"
        text = (folder / "__init__.py").read_text(encoding="utf-8")
        assert text.startswith('"""'), f"{folder} says nothing"


@each_of("package", OF_ROOMS)
def test_a_room_says_which_of_its_files_other_packages_import(package: str):
    own_name = package.removeprefix("search/").replace("/", ".")
    imported: dict[str, set[str]] = {}
    roots = (
        PACKAGE,
        *(PACKAGE.parent / "search" / one for one in ("ibrid_search", "policy/ibrid_policy")),
    )
    outside = [
        path
        for root in roots
        for path in root.rglob("*.py")
        if not path.is_relative_to(PACKAGE.parent / package)
    ]
    for path in outside:
        for _, name in imported_modules(path):
            room, _, file = name.removeprefix(f"{own_name}.").partition(".")
            if name.startswith(f"{own_name}.") and file:
                imported.setdefault(room, set()).add(file.split(".")[0])
    for room in (
        one for one in (PACKAGE.parent / package).iterdir() if (one / "__init__.py").is_file()
    ):
        text = " ".join((room / "__init__.py").read_text(encoding="utf-8").split())
        if room.name in ("programs", "published"):
            continue
        said = re.search(rf"From outside of `{own_name.split('.')[-1]}`:([^.]*)\.", text)
        assert said, f"{room} does not say what may be imported"
        assert imported.get(room.name, set()) <= set(re.findall(r"`(\w+)`", said[1])), room


@pytest.mark.slow
def test_each_distribution_imports_only_those_below():
    above = {
        "ibrid_search": ("ibrid_policy", "ibrid_bench"),
        "policy/ibrid_policy": ("ibrid_bench",),
    }
    for package, forbidden in above.items():
        files = sorted((PACKAGE.parent / "search" / package).rglob("*.py"))
        assert files
        for path in files:
            for line, name in imported_modules(path):
                assert name.split(".")[0] not in forbidden, (
                    f"{package}: {path.name} line {line}: {name}"
                )
