"""One kind in full, as `ibrid modules KIND` and the tools of agents show it."""

from collections.abc import Mapping

from ibrid.modules.kind import ModuleKind
from ibrid.signals import Signal
from ibrid.writing import aligned

#: Nominal angular frequency at which the matrices of a kind are shown, rad/s.
OMEGA_SHOWN = 2 * 3.141592653589793 * 60


def kind_in_full(kind: ModuleKind) -> str:
    """Everything that a kind declares, with its matrices at typical values."""
    extended = (
        "beyond the paper's 23 kinds, off under --vocabulary paper"
        if kind.extended
        else "of the paper"
    )
    counted = ", as any delay or hold counts" if kind.order != len(kind.states) else ""
    rows = [
        ("family", f"{kind.family}, {extended}"),
        ("law", kind.law),
        ("inputs", _signals(kind.inputs)),
        ("outputs", _signals(kind.outputs)),
        ("states", ", ".join(kind.states) or "none"),
        ("order", f"{kind.order}{counted}"),
        ("gain at 0 Hz", _steady_gain(kind)),
        ("operating point", _operating_point(kind)),
        ("reference", kind.reference),
    ]
    lines = [kind.name, aligned(rows, "  "), "", *_parameter_lines(kind)]
    return "\n".join([*lines, "", *_matrix_lines(kind)])


def _signals(ports: Mapping[str, Signal]) -> str:
    return ", ".join(f"{name} ({signal.value})" for name, signal in ports.items()) or "none"


def _steady_gain(kind: ModuleKind) -> str:
    if kind.static:
        return "that of D, the kind is static"
    return (
        "none: it integrates, or its outputs at rest follow another law"
        if kind.dc_gain is None
        else f"{kind.dc_gain:g}"
    )


def _operating_point(kind: ModuleKind) -> str:
    needs = [f"the equilibrium at {port}" for port in kind.equilibrium_ports]
    needs += ["the angle of the controller frame"] if kind.uses_frame else []
    if not needs:
        return "does not enter"
    fitted = ", ".join(kind.paper_parameters)
    return f"uses {' and '.join(needs)}" + (
        f"; in paper mode the fitted {fitted}" if fitted else ""
    )


def _parameter_lines(kind: ModuleKind) -> list[str]:
    if not kind.parameters:
        return ["parameters: none"]
    rows = [("name", "unit", "box", "typical", "meaning")]
    rows += [
        (name, box.unit, f"[{box.low:g}, {box.high:g}]", f"{box.typical:g}", box.meaning)
        for name, box in kind.parameters.items()
    ]
    return ["parameters", aligned(rows, "  ")]


def _matrix_lines(kind: ModuleKind) -> list[str]:
    typical = {name: box.typical for name, box in kind.parameters.items()}
    needs_point = kind.equilibrium_ports or kind.uses_frame
    where = ", equilibria (1, 0) and the frame at rest" if needs_point else ""
    lines = [f"matrices at typical values, 60 Hz{where}"]
    if kind.delay:
        lines.append(
            "  without the delay itself: exact in frequency responses, a Pade form in exported "
            "matrices"
        )
    matrices = kind.matrices(**typical, **kind.context(OMEGA_SHOWN, (1.0, 0.0), {}))
    for label, rows in zip("ABCD", matrices, strict=True):
        cells = [[f"{float(value) + 0.0:.6g}" for value in row] for row in rows]
        if cells and cells[0]:
            text = aligned(cells).splitlines()
            lines += [f"  {label if k == 0 else ' '}  {line}" for k, line in enumerate(text)]
        else:
            lines.append(f"  {label}  empty")
    return lines
