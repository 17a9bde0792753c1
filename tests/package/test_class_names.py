"""A name has one meaning: no two classes of what is installed are called alike."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    ROOT / "ibrid",
    ROOT / "search" / "ibrid_search",
    ROOT / "search" / "policy" / "ibrid_policy",
)


def test_no_class_name_has_two_meanings():
    places: dict[str, list[str]] = defaultdict(list)
    for package in PACKAGES:
        for path in sorted(package.rglob("*.py")):
            if "programs" in path.parts:
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(f"{path.relative_to(ROOT)} line {node.lineno}")
    twice = {name: found for name, found in places.items() if len(found) > 1}
    assert not twice, f"say with a longer name what each of them is: {twice}"
