"""Loops of direct terms in numbers: which modules they join, whether they can be solved, and the
sentence if not.
"""

from collections.abc import Mapping, Sequence

import networkx as nx
import numpy as np
from scipy.linalg import matrix_balance

from ibrid.errors import DiagramError
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import Matrices
from ibrid.modules.vocabulary import usual_kind
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.grammar_rules.algebraic_loops import round_trips
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, sources_of, split_port

#: Smallest singular value of I - F over 1 + |F|, signals in balanced units, below which a loop
#: counts as singular.
SINGULAR = 1e-12


def joined_by_direct_terms(wiring: Wiring, matrices: Mapping[str, Matrices]) -> list[list[str]]:
    """Groups of modules that direct terms lead round to each other; between the groups there is an
    order.

    Raises DiagramError where a loop of direct terms has no unique solution.
    """
    graph = _direct_terms(wiring, matrices)
    for loop in round_trips(graph):
        channels = sorted(loop)
        through = nx.to_numpy_array(graph, nodelist=channels, weight="gain").T
        inverse_of_loop(wiring, channels, np.eye(len(channels)) - through)
    modules = nx.DiGraph()
    modules.add_edges_from(
        (split_port(source[0])[0], split_port(target[0])[0]) for source, target in graph.edges
    )
    places = {name: index for index, name in enumerate(wiring.kinds)}
    groups = [sorted(group, key=places.__getitem__) for group in round_trips(modules)]
    return sorted(groups, key=lambda group: places[group[0]])


def inverse_of_loop(wiring: Wiring, channels: Sequence[Channel], matrix: np.ndarray) -> np.ndarray:
    """(I - F)^-1 of a loop of direct terms among output channels; DiagramError, naming the loop, if
    it is singular.
    """
    if not np.isfinite(matrix).all():
        return np.full(matrix.shape, np.nan)
    size = len(channels)
    balanced, (scale, _) = matrix_balance(np.eye(size) - matrix, permute=False, separate=True)
    solvable = np.eye(size) - balanced
    if np.linalg.svd(solvable, compute_uv=False)[-1] < SINGULAR * (1 + np.linalg.norm(balanced)):
        raise DiagramError(_singular(wiring, channels, solvable))
    return scale[:, None] * np.linalg.inv(solvable) / scale


def _direct_terms(wiring: Wiring, matrices: Mapping[str, Matrices]) -> nx.DiGraph:
    """Output channel -> output channel that depends on it at once, with the gain."""
    graph = nx.DiGraph()
    for name, kind in wiring.kinds.items():
        inputs = channels_of(name, kind.inputs)
        for output, row in zip(channels_of(name, kind.outputs), matrices[name][3], strict=True):
            for channel, gain in zip(inputs, row, strict=True):
                for source in sources_of(wiring, channel):
                    if gain != 0 and source[0] != TERMINAL_VOLTAGE:
                        before = graph.get_edge_data(source, output, {"gain": 0.0})["gain"]
                        graph.add_edge(source, output, gain=before + float(gain))
    return graph


def _singular(wiring: Wiring, channels: Sequence[Channel], matrix: np.ndarray) -> str:
    """The sentence, with the modules in the order of the signals that have no unique value."""
    direction = np.abs(np.linalg.svd(matrix)[2][-1])
    involved = [
        index for index in range(len(channels)) if direction[index] > 1e-6 * direction.max()
    ]
    edges = [(j, i) for i in involved for j in involved if matrix[i, j] != (1.0 if i == j else 0.0)]
    try:
        cycle = [start for start, _ in nx.find_cycle(nx.DiGraph(edges))]
    except (nx.NetworkXNoCycle, nx.NetworkXError):
        cycle = involved
    names = list(dict.fromkeys(split_port(channels[index][0])[0] for index in cycle))
    first = min(range(len(names)), key=lambda index: list(wiring.kinds).index(names[index]))
    path = " -> ".join((*names[first:], *names[:first], names[first]))
    if delays := [name for name in names if wiring.kinds[name].delay is not None]:
        return (
            f"the loop of direct terms {path} has a gain of exactly 1 when {delays[0]} is a Pade "
            "form, whose direct "
            "term is 1 or -1; put a filter in it, or change a gain"
        )
    return (
        f"the loop of direct terms {path} is singular: its gain is 1, so that its signals have no "
        "unique value; put a "
        f"filter or a {usual_kind(Element.DELAY).name} in it, or change a gain"
    )
