"""Canonical labelling: a form of a graph that does not depend on how its vertices are numbered, and
the graph of a diagram.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from networkx.utils import UnionFind

from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Instance
from ibrid.structure.reading.parameters import ParameterTable, kind_parameters
from ibrid.structure.reading.wiring import Wiring, split_port

#: An edge of a labelled graph: start, end, label.
#: Vertex -> colour.
Colours = dict[int, int]
Edge = tuple[int, int, str]

#: Vertices told apart before symmetry is given up; far above what a drawn controller needs.
MOST_CHOICES = 1000


@dataclass(frozen=True)
class CanonicalForm:
    """`order` : vertices in canonical order. `text` : equal for isomorphic graphs, whatever their
    vertex numbers.

    `exact` : False when symmetry was given up; `text` then holds the refined colours alone, which
    do not depend on the numbering either but may agree for graphs that differ.
    """

    order: tuple[int, ...]
    text: str
    exact: bool


def canonical_form(labels: Sequence[str], edges: Sequence[Edge]) -> CanonicalForm:
    """Canonical form of a graph with vertex labels and labelled edges."""
    return _Labelling(labels, edges).form()


class _Labelling:
    """Colours are ranks that do not depend on the numbering of the vertices; `around` holds a
    vertex's neighbours.
    """

    def __init__(self, labels: Sequence[str], edges: Sequence[Edge]) -> None:
        self.labels = list(labels)
        words = {label: index for index, label in enumerate(sorted({label for *_, label in edges}))}
        self.edge_words = list(words)
        self.edges = [(start, end, words[label]) for start, end, label in edges]
        self.around: list[list[tuple[int, int]]] = [[] for _ in labels]
        for start, end, word in self.edges:
            self.around[start].append((2 * word, end))
            self.around[end].append((2 * word + 1, start))
        self.choices = 0

    def form(self) -> CanonicalForm:
        rank = {label: index for index, label in enumerate(sorted(set(self.labels)))}
        colours = self._refined({vertex: rank[label] for vertex, label in enumerate(self.labels)})
        order = self._order(colours)
        exact = order is not None
        if order is None:
            order = sorted(colours, key=colours.__getitem__)
        place = {vertex: index for index, vertex in enumerate(order)} if exact else colours
        edges = sorted((place[start], place[end], word) for start, end, word in self.edges)
        named = [self.labels[vertex] for vertex in order]
        return CanonicalForm(tuple(order), repr((exact, named, self.edge_words, edges)), exact)

    def _refined(self, colours: Colours) -> Colours:
        """Split colours by the colours around, within the vertices given, until nothing splits."""
        around = {
            vertex: [one for one in self.around[vertex] if one[1] in colours] for vertex in colours
        }
        number = len(set(colours.values()))
        while True:
            keys = {
                vertex: (
                    colour,
                    tuple(sorted([(word, colours[other]) for word, other in around[vertex]])),
                )
                for vertex, colour in colours.items()
            }
            rank = {key: index for index, key in enumerate(sorted(set(keys.values())))}
            colours = {vertex: rank[key] for vertex, key in keys.items()}
            if len(rank) == number:
                return colours
            number = len(rank)

    def _order(self, colours: Colours) -> list[int] | None:
        """Canonical order of vertices with refined colours; None when there is too much
        symmetry.
        """
        cells: dict[int, list[int]] = {}
        for vertex, colour in colours.items():
            cells.setdefault(colour, []).append(vertex)
        order = [cells[colour][0] for colour in sorted(cells) if len(cells[colour]) == 1]
        tied = {vertex: colour for vertex, colour in colours.items() if len(cells[colour]) > 1}
        parts = []
        for part in self._components(tied):
            inner = self._order(part) if len(part) < len(colours) else self._told_apart(part)
            if inner is None:
                return None
            parts.append((self._certificate(inner, colours), inner))
        # parts of equal certificate are alike and alike seen from outside, so that their order does
        # not matter
        return order + [
            vertex for _, inner in sorted(parts, key=lambda part: part[0]) for vertex in inner
        ]

    def _told_apart(self, colours: Colours) -> list[int] | None:
        """Canonical order of one component in which every colour ties: the least over the choices
        of a first vertex.
        """
        cells: dict[int, list[int]] = {}
        for vertex, colour in colours.items():
            cells.setdefault(colour, []).append(vertex)
        cell = cells[min(cells, key=lambda colour: (len(cells[colour]), colour))]
        leaves: list[tuple[list, list[int]]] = []
        orbits, tried = UnionFind(colours), list[int]()
        for vertex in cell:
            if any(orbits[vertex] == orbits[one] for one in tried):
                continue
            tried.append(vertex)
            self.choices += 1
            if self.choices > MOST_CHOICES:
                return None
            marked = {one: 2 * colour + (one != vertex) for one, colour in colours.items()}
            order = self._order(self._refined(marked))
            if order is None:
                return None
            certificate = self._certificate(order, colours)
            for known, other in leaves:
                if known == certificate:
                    for pair in zip(other, order, strict=True):
                        orbits.union(*pair)
                    break
            else:
                leaves.append((certificate, order))
        return min(leaves, key=lambda leaf: leaf[0])[1]

    def _certificate(self, order: list[int], colours: Colours) -> list:
        place = {vertex: index for index, vertex in enumerate(order)}
        inside = [
            (place[vertex], word, place[other])
            for vertex in order
            for word, other in self.around[vertex]
            if other in place and word % 2 == 0
        ]
        return [[colours[vertex] for vertex in order], sorted(inside)]

    def _components(self, colours: Colours) -> list[Colours]:
        """Parts joined by edges that tell vertices of a colour apart; colours must be refined."""
        size = Counter(colours.values())
        parts, left = [], dict(colours)
        while left:
            front = [next(iter(left))]
            part = {front[0]: left.pop(front[0])}
            for vertex in front:
                others = [
                    (word, other)
                    for word, other in self.around[vertex]
                    if other in colours and other != vertex
                ]
                reach = Counter((word, colours[other]) for word, other in others)
                for word, other in others:
                    alike = colours[other] == colours[vertex]
                    everyone = reach[word, colours[other]] == size[colours[other]] - alike
                    if other in left and not everyone:
                        part[other] = left.pop(other)
                        front.append(other)
            parts.append(part)
        return parts


def structure_graph(
    wiring: Wiring, table: ParameterTable, equilibrium: str
) -> tuple[list[str], list[Edge]]:
    """Draw the labelled graph whose canonical form is that of a diagram.

    Vertices: the outer ports, the modules, the shared parameters; edges: connections and uses of a
    parameter.
    """
    labels = [f"outer {TERMINAL_VOLTAGE}", f"outer {TERMINAL_CURRENT}"]
    place = {TERMINAL_VOLTAGE: 0, TERMINAL_CURRENT: 1}
    for instance in wiring.instances:
        place[instance.name] = len(labels)
        labels.append(_label(instance, wiring, table, equilibrium))
    edges = [
        _edge(source, target, place)
        for target, sources in wiring.sources.items()
        for source in sources
    ]
    for parameter in table.free:
        if len(parameter.members) > 1:
            edges += [
                (len(labels), place[name], f"parameter {own}") for name, own in parameter.members
            ]
            labels.append("parameter")
    return labels, edges


def _label(instance: Instance, wiring: Wiring, table: ParameterTable, equilibrium: str) -> str:
    words = [instance.kind]
    for parameter, box in kind_parameters(wiring.kinds[instance.name], equilibrium).items():
        bound = table.bound[instance.name, parameter]
        narrower = instance.bindings.get(parameter)
        if isinstance(bound, float):
            words.append(f"{parameter}={bound + 0.0!r}")  # -0.0 is 0.0
        elif isinstance(narrower, tuple) and narrower != box.unbound:
            words.append(f"{parameter} in {narrower!r}")
    return "module " + " ".join(words)


def _edge(source: str, target: str, place: dict[str, int]) -> tuple[int, int, str]:
    (start, output), (end, entry) = split_port(source), split_port(target)
    return place[start or output], place[end or entry], f"{output} to {entry}"
