"""Rules for the modules of a diagram one by one: kinds, names, bindings and their boxes, shared names."""

import math
from collections.abc import Sequence

from ibrid.modules.kind import PAPER_RANGES, ModuleKind, Range
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagram import Binding, Diagram, Instance
from ibrid.structure.parameters import kind_parameters
from ibrid.structure.violation import Findings, first_line, shown, some
from ibrid.structure.wiring import PLANT


def check_modules(
    diagram: Diagram, vocabulary: Sequence[ModuleKind], equilibrium: str, findings: Findings
) -> dict[str, ModuleKind | None]:
    """Report what is wrong with modules and bindings; instance name -> kind, None where the kind is unknown."""
    known = {kind.name: kind for kind in vocabulary}
    kinds: dict[str, ModuleKind | None] = {}
    first: dict[str, Instance] = {}
    for instance in diagram.instances:
        kind = known.get(instance.kind)
        if kind is None:
            findings.add(instance.line, "unknown_kind", _unknown_kind(instance, known, findings))
        else:
            _check_bindings(instance, kind, equilibrium, findings)
        if instance.name in first:
            where = first_line(first[instance.name].line)
            message = f"the name {instance.name} is used twice{where}; give this {instance.kind[:64]} a name of its own"
            findings.add(instance.line, "duplicate_name", message)
        else:
            first[instance.name] = instance
            kinds[instance.name] = kind
    _check_shared(diagram, kinds, equilibrium, findings)
    return kinds


def _unknown_kind(instance: Instance, known: dict[str, ModuleKind], findings: Findings) -> str:
    extended = {kind.name for kind in VOCABULARY if kind.extended}
    if instance.kind in extended:
        return (
            f"{instance.kind} (module {instance.name}) is an extended kind that this vocabulary leaves out; "
            "use the extended vocabulary or a kind of the paper"
        )
    hint = findings.near(instance.kind, known)
    return f"the vocabulary has no kind {shown(instance.kind)} (module {instance.name}); {hint}"


def _check_bindings(instance: Instance, kind: ModuleKind, equilibrium: str, findings: Findings) -> None:
    boxes = kind_parameters(kind, equilibrium)
    where = f"{instance.name} ({kind.name})"
    for name, value in instance.bindings.items():
        if name in boxes:
            if fault := _binding_fault(f"{instance.name}.{name}", value, boxes[name], kind.family == PLANT):
                findings.add(instance.line, "box", fault)
        elif name not in kind.paper_parameters:  # those are accepted and ignored under "exact"
            if not boxes:
                remedy = "this kind has no parameters, so remove the binding"
            else:
                remedy = findings.near(name, boxes)
            findings.add(instance.line, "binding", f"{where} has no parameter {shown(name)}; {remedy}")


def _binding_fault(where: str, value: Binding, box: Range, plant: bool) -> str | None:
    limits = f"[{box.low:g}, {box.high:g}] {box.unit}"
    if isinstance(value, tuple):
        low, high = value
        if box.low <= low < high <= box.high:
            return None
        return f"the box ({low:g}, {high:g}) of {where} must lie within {limits}; narrow it"
    if isinstance(value, str):
        return None
    if not math.isfinite(value):
        return f"{where} is fixed to {value}; write a finite number"
    if plant and not box.low <= value <= box.high:
        return (
            f"{where} is fixed to {value:g}, but a plant parameter lies within {limits}; move it there or let it free"
        )
    if box.divides and value <= 0:
        return f"{where} is fixed to {value:g}, but its law needs a number above zero; it usually lies within {limits}"
    return None


def _check_shared(diagram: Diagram, kinds: dict[str, ModuleKind | None], equilibrium: str, findings: Findings) -> None:
    members: dict[str, list[tuple[Instance, str, float, float]]] = {}
    for instance in diagram.instances:
        kind = kinds.get(instance.name)
        if kind is None:
            continue
        for parameter, box in kind_parameters(kind, equilibrium).items():
            value = instance.bindings.get(parameter)
            own = parameter if parameter in PAPER_RANGES else f"{instance.name}.{parameter}"
            low, high = value if isinstance(value, tuple) else (box.low, box.high)
            if value is None or isinstance(value, str | tuple):
                name = value if isinstance(value, str) else own
                members.setdefault(name, []).append((instance, parameter, low, high))
    for name, sharing in members.items():
        low = max(sharing, key=lambda member: member[2])
        high = min(sharing, key=lambda member: member[3])
        if len(sharing) > 1 and not low[2] < high[3]:
            where = some(f"{one[0].name}.{one[1]} ({one[2]:g} to {one[3]:g})" for one in (low, high))
            line = max((one[0].line for one in sharing if one[0].line is not None), default=None)
            message = f"{where} share the name {name}, but their boxes do not overlap; give them names of their own"
            findings.add(line, "shared_box", message)
