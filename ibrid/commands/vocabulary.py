"""`ibrid modules [KIND]`: the vocabulary as a table, or one kind in full."""

from argparse import Namespace
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ibrid.commands.outputs import complain, table

if TYPE_CHECKING:
    from ibrid.modules.kind import ModuleKind, Range
    from ibrid.signals import Signal

#: Nominal angular frequency at which the matrices of a kind are shown, rad/s.
OMEGA_SHOWN = 2 * 3.141592653589793 * 60


def declare(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser("modules", help="the vocabulary, as a table or one kind in full")
    parser.add_argument("kind", nargs="?", metavar="KIND", help="the kind to show in full")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Print the table, or everything about one kind."""
    from ibrid.modules.vocabulary import find_kind
    from ibrid.plugins import extended_vocabulary, listed_plugins

    kinds = extended_vocabulary(complain)
    if arguments.kind is None:
        print("\n".join([vocabulary_table(kinds), *(f"Plug-in {line}" for line in listed_plugins())]))
        return 0
    same = [kind.name for kind in kinds if kind.name.casefold() == arguments.kind.casefold()]
    print(kind_in_full(find_kind(same[0] if len(same) == 1 else arguments.kind, kinds)))
    return 0


def vocabulary_table(kinds: "tuple[ModuleKind, ...]") -> str:
    """Kinds by family: ports, order, parameters with their boxes; extended kinds carry a +."""
    lines: list[str] = []
    rows = [("kind", "inputs -> outputs", "order", "parameters [box]")]
    families: dict[str, list[int]] = {}
    for kind in kinds:
        families.setdefault(kind.family, []).append(len(rows))
        boxes = ", ".join(f"{name} [{box.low:g}, {box.high:g}]{_unit(box)}" for name, box in kind.parameters.items())
        ports = f"{_ports(kind.inputs)} -> {_ports(kind.outputs)}".strip()
        rows.append((kind.name + ("+" if kind.extended else ""), ports, str(kind.order), boxes or "-"))
    aligned = table(rows, "  ").splitlines()
    lines.append(aligned[0])
    for family, members in families.items():
        lines += ["", family, *(aligned[member] for member in members)]
    lines += [
        "",
        "Ports with a colon carry a dq pair, the others a scalar. + is beyond the paper's 23: --vocabulary extended.",
        "Parameters are per unit unless a unit is given. `ibrid modules KIND` tells all of one kind.",
    ]
    return "\n".join(lines)


def kind_in_full(kind: "ModuleKind") -> str:
    """Everything that a kind declares, with its matrices at typical values."""
    extended = (
        "extended: beyond the paper's 23 kinds, off under --vocabulary paper" if kind.extended else "of the paper"
    )
    delay = f", a transport delay of {kind.delay} that counts as 2" if kind.delay else ""
    rows = [
        ("family", f"{kind.family}, {extended}"),
        ("law", kind.law),
        ("inputs", _signals(kind.inputs)),
        ("outputs", _signals(kind.outputs)),
        ("states", ", ".join(kind.states) or "none"),
        ("order", f"{kind.order}{delay}"),
        ("gain at 0 Hz", _steady_gain(kind)),
        ("operating point", _operating_point(kind)),
        ("reference", kind.reference),
    ]
    lines = [kind.name, table(rows, "  "), "", *_parameter_lines(kind)]
    return "\n".join([*lines, "", *_matrix_lines(kind)])


def _ports(ports: "Mapping[str, Signal]") -> str:
    return " ".join(name + (":" if signal.width == 2 else "") for name, signal in ports.items())


def _signals(ports: "Mapping[str, Signal]") -> str:
    return ", ".join(f"{name} ({signal.value})" for name, signal in ports.items()) or "none"


def _unit(box: "Range") -> str:
    return "" if box.unit in ("pu", "1", "") else f" {box.unit}"


def _steady_gain(kind: "ModuleKind") -> str:
    if kind.static:
        return "that of D, the kind is static"
    return (
        "none: it integrates, or its outputs at rest follow another law"
        if kind.dc_gain is None
        else f"{kind.dc_gain:g}"
    )


def _operating_point(kind: "ModuleKind") -> str:
    needs = [f"the equilibrium at {port}" for port in kind.equilibrium_ports]
    needs += ["the angle of the controller frame"] if kind.uses_frame else []
    if not needs:
        return "does not enter"
    fitted = ", ".join(kind.paper_parameters)
    return f"uses {' and '.join(needs)}" + (f"; in paper mode the fitted {fitted}" if fitted else "")


def _parameter_lines(kind: "ModuleKind") -> list[str]:
    if not kind.parameters:
        return ["parameters: none"]
    rows = [("name", "unit", "box", "typical", "meaning")]
    rows += [
        (name, box.unit, f"[{box.low:g}, {box.high:g}]", f"{box.typical:g}", box.meaning)
        for name, box in kind.parameters.items()
    ]
    return ["parameters", table(rows, "  ")]


def _matrix_lines(kind: "ModuleKind") -> list[str]:
    typical = {name: box.typical for name, box in kind.parameters.items()}
    needs_point = kind.equilibrium_ports or kind.uses_frame
    where = ", equilibria (1, 0) and the frame at rest" if needs_point else ""
    lines = [f"matrices at typical values, 60 Hz{where}"]
    if kind.delay:
        lines.append("  without the delay itself: exact in frequency responses, a Pade form in exported matrices")
    matrices = kind.state_space(**typical, **kind.context(OMEGA_SHOWN, (1.0, 0.0), {}))
    for label, rows in zip("ABCD", matrices, strict=True):
        cells = [[f"{float(value) + 0.0:.6g}" for value in row] for row in rows]
        if cells and cells[0]:
            text = table(cells).splitlines()
            lines += [f"  {label if k == 0 else ' '}  {line}" for k, line in enumerate(text)]
        else:
            lines.append(f"  {label}  empty")
    return lines
