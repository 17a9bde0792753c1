"""The vocabulary as an agent reads it, from the declarations of the kinds, and how programs are written."""

from typing import Any

from ibrid.modules.kind import ModuleKind, Range

#: The language and its grammar in the words of a reader who has never seen it.
LANGUAGE = (
    "A program is `def NAME(g):` with lines g.add(KIND, NAME, parameter=binding) and g.connect(SOURCE, TARGET), nothing else.",
    "A port is NAME.port; v_DQ (terminal voltage, a source) and i_DQ (terminal current, a target) are the outer ports.",
    "Several sources of one target add up; every input needs at least one; both ends carry the same kind of signal.",
    "Exactly one plant; the order is at most 30; parameters stay symbolic and are fitted by the evaluator.",
    "A binding is a name in quotes (parameters of one name share one value), a number (fixed, may be negative) or a pair "
    "(low, high) that narrows the box.",
)


def in_short(kind: ModuleKind) -> dict[str, Any]:
    """Law, ports and boxes of a kind."""
    return {
        "kind": kind.name,
        "family": kind.family,
        "law": kind.law,
        "inputs": ", ".join(f"{name} ({signal.value})" for name, signal in kind.inputs.items()),
        "outputs": ", ".join(f"{name} ({signal.value})" for name, signal in kind.outputs.items()),
        "order": kind.order,
        "parameters": ", ".join(
            f"{name} [{box.low:.3g}, {box.high:.3g}] {box.unit}" for name, box in kind.parameters.items()
        ),
    }


def in_full(kind: ModuleKind) -> dict[str, Any]:
    """Everything that a kind declares in words and numbers."""
    return {
        **in_short(kind),
        "states": kind.states,
        "parameters": [_box(name, box) for name, box in kind.parameters.items()],
        "operating_point_of": kind.equilibrium_ports,
        "uses_frame": kind.uses_frame,
        "extended": kind.extended,
        "reference": kind.reference,
    }


def _box(name: str, box: Range) -> dict[str, Any]:
    return {
        "name": name,
        "low": box.low,
        "high": box.high,
        "typical": box.typical,
        "unit": box.unit,
        "meaning": box.meaning,
    }
