"""Outputs of a plant that others determine, such as i_C = i_ti - i_g, or its inputs, such as e = v_in."""

import numpy as np

from ibrid.modules.kind import ModuleKind

#: ("output" | "input", port) -> matrix, whose sum over the entries gives the derived output.
Origins = dict[tuple[str, str], np.ndarray]


def derived_outputs(kind: ModuleKind) -> dict[str, Origins]:
    """The outputs of a kind with states that others determine, with whole-number weights; found from C and D."""
    if not kind.states or len(kind.outputs) < 2:
        return {}
    values = {name: box.typical for name, box in kind.parameters.items()}
    a, _, c, d = (
        np.array(rows, dtype=float) for rows in kind.state_space(**values, **kind.context(377.0, (1.0, 0.0), {}))
    )
    rows = np.hstack([c.reshape(-1, len(a)), d])
    through = np.hstack([np.zeros((d.shape[1], len(a))), np.eye(d.shape[1])])
    basis: list[tuple[tuple[str, str], np.ndarray]] = []
    left = 0
    for port, signal in kind.inputs.items():
        basis.append((("input", port), through[left : left + signal.width]))
        left += signal.width
    origins: dict[str, Origins] = {}
    for port, own in _wide_first(kind, rows):
        stacked = np.vstack([block for _, block in basis])
        weights = np.linalg.lstsq(stacked.T, own.T, rcond=None)[0].T
        whole = np.round(weights)
        if np.allclose(whole @ stacked, own, atol=1e-12) and np.abs(weights - whole).max() < 1e-9:
            origins[port] = _split(whole, basis)
        else:
            basis.append((("output", port), own))
    return origins


def _wide_first(kind: ModuleKind, rows: np.ndarray) -> list[tuple[str, np.ndarray]]:
    ports, top = [], 0
    for port, signal in kind.outputs.items():
        ports.append((port, rows[top : top + signal.width]))
        top += signal.width
    return sorted(ports, key=lambda one: -len(one[1]))


def _split(weights: np.ndarray, basis: list[tuple[tuple[str, str], np.ndarray]]) -> Origins:
    origins, left = {}, 0
    for where, block in basis:
        part = weights[:, left : left + len(block)]
        left += len(block)
        if part.any():
            origins[where] = part
    return origins
