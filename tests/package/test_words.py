"""Names that live longer than three lines say what they are, so that they can be searched for."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Names that say nothing, and lines that they may live.
NOTHING, LIVED = ("one", "found"), 3
INNER = (ast.FunctionDef, ast.Lambda, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


def uses(node: ast.AST, name: str) -> Iterator[int]:
    """Lines of a function in which it, and not what is defined within, uses a name."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, INNER) and name in own(child):
            continue
        if (isinstance(child, ast.Name) and child.id == name) or (
            isinstance(child, ast.arg) and child.arg == name
        ):
            yield child.lineno
        yield from uses(child, name)


def own(inner: ast.AST) -> set[str]:
    """Names that a lambda or a comprehension has of its own; a function within is looked at by
    itself.
    """
    if isinstance(inner, ast.FunctionDef | ast.Lambda):
        names = {one.arg for one in ast.walk(inner.args) if isinstance(one, ast.arg)}
        return names | {*NOTHING} if isinstance(inner, ast.FunctionDef) else names
    targets = [one.target for one in getattr(inner, "generators", [])]
    return {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}


@pytest.mark.slow
def test_what_lives_longer_than_three_lines_has_a_name_that_says_what_it_is():
    wrong = []
    for path in [
        *(ROOT / "ibrid").rglob("*.py"),
        *(ROOT / "search" / "ibrid_search").rglob("*.py"),
    ]:
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for name in NOTHING if isinstance(function, ast.FunctionDef) else ():
                lines = sorted(uses(function, name))
                if lines and lines[-1] - lines[0] > LIVED:
                    wrong.append(f"{path.relative_to(ROOT)}:{lines[0]} {function.name}: {name}")
    assert wrong == []
