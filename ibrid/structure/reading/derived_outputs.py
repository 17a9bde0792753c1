"""Outputs of a plant that others determine, such as i_C = i_ti - i_g, or its inputs, such as e =
v_in.
"""

from collections.abc import Mapping

import numpy as np

from ibrid.modules.behaviour import numbers_of
from ibrid.modules.kind import ModuleKind
from ibrid.signals import Signal

#: ("output" | "input", port) -> matrix, whose sum over the entries gives the derived output.
Origins = dict[tuple[str, str], np.ndarray]


def derived_outputs(kind: ModuleKind) -> dict[str, Origins]:
    """The outputs of a kind with states that others determine, with whole-number weights; found
    from C and D.
    """
    if not kind.states or len(kind.outputs) < 2:
        return {}
    values = {name: box.typical for name, box in kind.parameters.items()}
    a, _, c, d = numbers_of(kind, values | kind.context(377.0, (1.0, 0.0), {}))
    rows = np.hstack([c, d])
    through = np.hstack([np.zeros((d.shape[1], len(a))), np.eye(d.shape[1])])
    basis = [(("input", port), own) for port, own in by_port(kind.inputs, through).items()]
    origins: dict[str, Origins] = {}
    for port, own in sorted(by_port(kind.outputs, rows).items(), key=lambda one: -len(one[1])):
        stacked = np.vstack([block for _, block in basis])
        weights = np.linalg.lstsq(stacked.T, own.T, rcond=None)[0].T
        whole = np.round(weights)
        if np.allclose(whole @ stacked, own, atol=1e-12) and np.abs(weights - whole).max() < 1e-9:
            parts = np.split(whole, np.cumsum([len(block) for _, block in basis[:-1]]), axis=1)
            origins[port] = {
                where: part for (where, _), part in zip(basis, parts, strict=True) if part.any()
            }
        else:
            basis.append((("output", port), own))
    return origins


def by_port(ports: Mapping[str, Signal], rows: np.ndarray) -> dict[str, np.ndarray]:
    """port -> its rows, of a matrix with one row for each channel."""
    ends = np.cumsum([signal.width for signal in ports.values()])
    return dict(zip(ports, np.split(rows, ends)[:-1], strict=True))
