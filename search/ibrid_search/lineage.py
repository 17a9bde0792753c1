"""How a candidate came about: its line of descent from the start, with what each edit changed in the program."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from ibrid.structure.difference import difference
from ibrid_search.step import Status, Step


@dataclass(frozen=True)
class Ancestor:
    """A step on the way to a candidate.

    `difference` : lines of its program that differ from its parent's, " ", "+" or "-" first. `others` : the parent's
    other children that were fitted, the lowest error first.
    """

    step: Step
    difference: tuple[str, ...] = ()
    others: tuple[Step, ...] = ()


def lineage(steps: Mapping[int, Step], number: int) -> tuple[Ancestor, ...]:
    """The way from the start to a step, oldest first; it begins later where a parent is not among the steps."""
    path: list[Step] = []
    seen: set[int] = set()
    here = steps.get(number)
    while here is not None and here.number not in seen:
        seen.add(here.number)
        path.append(here)
        here = None if here.parent is None else steps.get(here.parent)
    path.reverse()
    found = [Ancestor(step) for step in path[:1]]
    for parent, step in pairwise(path):
        found.append(Ancestor(step, difference(parent.program, step.program), _others(steps, parent, step)))
    return tuple(found)


def _others(steps: Mapping[int, Step], parent: Step, child: Step) -> tuple[Step, ...]:
    found = [
        step
        for step in steps.values()
        if step.parent == parent.number and step.number != child.number and step.status is Status.OK
    ]
    return tuple(sorted(found, key=lambda step: (step.nrmse is None, step.nrmse, step.number)))
