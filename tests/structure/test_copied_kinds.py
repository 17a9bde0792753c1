"""A copy of a kind that ships, under another name, is treated as the kind: every kind, in a textbook diagram that has it."""

from dataclasses import replace
from functools import cache

import pytest

from ibrid.gap.ports import ports
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import insertions
from ibrid.structure.check import examine
from ibrid.structure.compare import compare
from ibrid.structure.diagram import Diagram, Instance
from ibrid.structure.library import textbook, textbook_names
from ibrid.structure.roles import roles
from ibrid.structure.simplify import simplified


@cache
def _user_of(kind: str) -> str:
    """A textbook diagram with the kind, the smallest."""
    using = [name for name in textbook_names() if any(one.kind == kind for one in textbook(name).instances)]
    return min(using, key=lambda name: len(textbook(name).instances), default="")


USED = [kind for kind in VOCABULARY if _user_of(kind.name)]


def _copied(kind: ModuleKind) -> tuple[Diagram, Diagram, tuple[ModuleKind, ...]]:
    """A diagram, the same with a copy of a kind in its place, and a vocabulary for both."""
    diagram = textbook(_user_of(kind.name))
    other = Diagram(diagram.name)
    renamed = [
        Instance(f"My{one.kind}" if one.kind == kind.name else one.kind, one.name, one.bindings)
        for one in diagram.instances
    ]
    other.extend(renamed, diagram.connections)
    return diagram, other, (*VOCABULARY, replace(kind, name=f"My{kind.name}"))


@pytest.mark.parametrize("kind", USED, ids=lambda kind: kind.name)
def test_a_copy_is_seen_as_the_kind(kind):
    diagram, other, kinds = _copied(kind)
    assert roles(other, kinds) == roles(diagram, kinds)
    told, expected = ([[one.message for one in part] for part in examine(one, kinds)] for one in (other, diagram))
    assert [[message.replace(f"My{kind.name}", kind.name) for message in part] for part in told] == expected


@pytest.mark.parametrize("kind", USED, ids=lambda kind: kind.name)
def test_a_copy_is_simplified_as_the_kind(kind):
    diagram, other, kinds = _copied(kind)
    one, same = simplified(diagram, kinds), simplified(other, kinds)
    assert sorted(sorted(block.names) for block in one.blocks.values()) == sorted(
        sorted(block.names) for block in same.blocks.values()
    )
    ends = [
        sorted(
            (sorted(drawing.blocks[key[0]].names), key[1], sorted(drawing.blocks[key[2]].names), key[3])
            for key in drawing.links
        )
        for drawing in (one, same)
    ]
    assert ends[0] == ends[1]
    own = compare(other, other, kinds)
    assert own.same
    assert own.connections == compare(diagram, diagram, kinds).connections


@pytest.mark.parametrize("kind", USED, ids=lambda kind: kind.name)
def test_a_copy_has_the_places_of_the_kind(kind):
    diagram, other, kinds = _copied(kind)
    assert [port.name for port in ports(other, kinds)] == [port.name for port in ports(diagram, kinds)]


def test_a_copy_gets_the_edits_of_the_kind():
    missing = {}
    for kind in USED:
        diagram, other, kinds = _copied(kind)
        found, expected = (
            sorted((one.effect, one.change) for one in insertions(each, kinds)) for each in (other, diagram)
        )
        if found != expected:
            missing[kind.name] = len(found), len(expected)
    assert not missing
