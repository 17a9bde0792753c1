"""Blocks and diagrams drawn into pages while the site is built, where one says <!-- block KIND -->
or <!-- diagram NAME -->.

Diagrams are drawn as on the package's own pages, blocks alike; their colours are those of the site,
light and dark.
"""

import re
from collections.abc import Iterator
from typing import Any

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, find_kind
from ibrid.report.block_diagrams.block_diagram import block_diagram_svg
from ibrid.structure.diagrams.library import textbook

_PLACE = re.compile(r"<!-- (block|diagram) (\w+) -->")
#: Of a block, in px: a port's row, its wire, an advance for each letter of a name.
_ROW, _WIRE, _LETTER = 22, 34, 7.4


def setup(app: Any) -> dict[str, bool]:
    """What Sphinx calls."""
    app.connect(
        "source-read", lambda app, page, source: source.__setitem__(0, illustrated(source[0]))
    )
    return {"parallel_read_safe": True}


def illustrated(text: str) -> str:
    """The text of a page with its pictures."""
    return _PLACE.sub(
        lambda found: f'<div class="drawing">{_drawn(found[1], found[2])}</div>', text
    )


def _drawn(what: str, name: str) -> str:
    if what == "diagram":
        return block_diagram_svg(textbook(name), VOCABULARY)
    return block_svg(find_kind(name, VOCABULARY))


def block_svg(kind: ModuleKind) -> str:
    """A block with its ports: inputs on the left, outputs on the right, thick wires for dq
    pairs.
    """
    sides = (kind.inputs, kind.outputs)
    margins = [_WIRE + 12 + _LETTER * max(map(len, ports), default=0) for ports in sides]
    wide = max(90, 24 + 8.4 * len(kind.name))
    high = 14 + _ROW * max(2, *map(len, sides))
    family = kind.family.replace(" ", "-")
    return (
        f'<svg class="diagram block" role="img" aria-label="The block {kind.name} and its ports" '
        f'viewBox="0 0 {sum(margins) + wide:.0f} {high + 4}" '
        f'style="width:{sum(margins) + wide:.0f}px">'
        f'{"".join(_ports(kind, margins[0], wide, high))}<g class="node family-{family}"><rect '
        f'x="{margins[0]:.1f}" y="2" '
        f'width="{wide:.1f}" height="{high}" rx="5"/><text class="name" '
        f'x="{margins[0] + wide / 2:.1f}" y="{high / 2 + 6.5}">'
        f"{kind.name}</text></g></svg>"
    )


def _ports(kind: ModuleKind, left: float, wide: float, high: float) -> Iterator[str]:
    """A wire with its tip and its name for each port; the tip is at the block's left edge or at the
    wire's right end.
    """
    for ports, edge, tip, name, anchor in (
        (kind.inputs, left - _WIRE, left, left - _WIRE - 6, "end"),
        (kind.outputs, left + wide, left + wide + _WIRE, left + wide + _WIRE + 6, "start"),
    ):
        for number, (port, signal) in enumerate(ports.items()):
            y = 2 + high / 2 + _ROW * (number - (len(ports) - 1) / 2)
            yield (
                f'<g class="net{" vector" if signal.width == 2 else ""}"><path d="M{edge:.1f} '
                f'{y:.1f}H{tip - 4:.1f}"/>'
            )
            yield f'<path class="tip" d="M{tip:.1f} {y:.1f}l-8 -3.6v7.2z"/></g>'
            yield f'<text class="value {anchor}" x="{name:.1f}" y="{y + 4:.1f}">{port}</text>'
