"""Damage: a whole inverter taken apart step by step down to the naive start, with wrong and
superfluous parts on the way.
"""

from collections.abc import Mapping

import numpy as np
from ibrid_search.screening.plausibility import refusal_reason

from ibrid.errors import DiagramError
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.compiling.check import examine
from ibrid.structure.diagrams.diagram import Connection, Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid_policy.experience.choices import PARTS, Choices, beyond_the_paper, consistent
from ibrid_policy.experience.spoiling import make_slip

#: How late a part is usually taken away: what an engineer puts in first goes last.
LAST: Mapping[str, float] = {
    "filter": 3.0,
    "current": 3.0,
    "frame": 3.0,
    "p": 2.5,
    "q": 2.5,
    "voltage": 2.0,
    "feedforward": 1.5,
    "decoupling": 1.5,
}
#: Share of the steps that put in something wrong or superfluous, and how many of them in a chain.
_ASTRAY, _MOST_ASTRAY = 0.3, 3


def taken_apart(rng: np.random.Generator, whole: Choices, *, paper: bool) -> list[dict[str, str]]:
    """Choices from the whole to none; neighbours differ in one part and what hangs on it."""
    chain = [consistent(whole)]
    astray = 0
    while chain[-1]:
        now = chain[-1]
        if astray < _MOST_ASTRAY and rng.random() < _ASTRAY:
            astray += 1
            following = _led_astray(rng, now, paper)
        else:
            parts = list(now)
            weight = np.exp([-LAST.get(part, 0.5) for part in parts])
            gone = parts[int(rng.choice(len(parts), p=weight / weight.sum()))]
            following = consistent({part: variant for part, variant in now.items() if part != gone})
        if following != now:
            chain.append(following)
    return chain


def _led_astray(rng: np.random.Generator, now: Choices, paper: bool) -> dict[str, str]:
    """One part exchanged for another variant, or one more put in."""
    part = str(rng.choice(list(PARTS)))
    variants = [
        one
        for one in PARTS[part]
        if one != now.get(part) and not (paper and beyond_the_paper(part, one))
    ]
    if part == "frame":
        variants = [one for one in variants if one not in ("hybrid", "oscillator")]
    if not variants:
        return dict(now)
    return consistent({**now, part: str(rng.choice(variants))})


def spoiled(
    rng: np.random.Generator, diagram: Diagram, kinds: Vocabulary, equilibrium: str
) -> Diagram | None:
    """A diagram after one random legal edit of its wires or of one module; None when none was found
    quickly.
    """
    for _ in range(8):
        draft = Draft(diagram, kinds)
        make_slip(draft, rng)
        draft.tidy()
        found = draft.diagram()
        if legal(found, kinds, equilibrium) and apart_by_names(found, diagram):
            return found
    return None


def legal(diagram: Diagram, kinds: Vocabulary, equilibrium: str) -> bool:
    """True for a diagram that a search would fit."""
    try:
        violations, warnings = examine(diagram, kinds, equilibrium=equilibrium)
    except DiagramError:
        return False
    return not violations and not refusal_reason(warnings)


def apart_by_names(one: Diagram, other: Diagram) -> bool:
    """True when two diagrams with common names differ."""
    return _content(one) != _content(other)


def merged(base: Diagram, spoilt: Diagram, better: Diagram) -> Diagram | None:
    """`better` with what `spoilt` does to `base` done to it as well; None where the two touch the
    same modules.
    """
    (kinds_0, wires_0), (kinds_1, wires_1), (kinds_2, wires_2) = map(
        _content, (base, spoilt, better)
    )
    lost, new = (
        kinds_0.keys() - kinds_1.keys(),
        {name: one for name, one in kinds_1.items() if kinds_0.get(name) != one},
    )
    if any(name in kinds_2 and kinds_2[name] != kinds_0.get(name) for name in (*new, *lost)):
        return None
    kinds = {name: one for name, one in kinds_2.items() if name not in lost} | new
    wires = [one for one in wires_2 if one not in wires_0 or one in wires_1]
    wires += [one for one in wires_1 if one not in wires_0 and one not in wires]
    names = {*kinds, ""}
    instances = {one.name: one for diagram in (spoilt, better) for one in diagram.instances}
    found = Diagram(better.name)
    found.extend(
        (instances[name] for name in kinds),
        [
            Connection(source, target)
            for source, target in wires
            if source.rpartition(".")[0] in names and target.rpartition(".")[0] in names
        ],
    )
    return found


def _content(diagram: Diagram) -> tuple[dict, list[tuple[str, str]]]:
    kinds = {
        one.name: (one.kind, tuple(sorted(one.bindings.items(), key=str)))
        for one in diagram.instances
    }
    return kinds, [(one.source, one.target) for one in diagram.connections]
