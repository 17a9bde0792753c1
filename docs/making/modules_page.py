"""The page about module kinds, from their declarations: picture, law, ports, parameters, and the
matrices in symbols.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from laws import law
from typesetting import expression

from ibrid.export.formula import Formula, formula
from ibrid.modules.kind import ModuleKind, Range
from ibrid.signals import Signal

_TOP = """\
# Module kinds

Made from the declarations in `ibrid/modules` by `python docs/making/write_pages.py`; a test
compares the two. `ibrid modules` prints the table, `ibrid modules KIND` one kind with its matrices
in numbers.

Diagrams consist of these {count} kinds. {paper} are those of the paper; the others, marked +, are
excluded by `--vocabulary paper`. Ports in *italics* carry a dq pair, the others a scalar. Per unit
on the inverter's base where no unit is given; time constants in s, cutoff frequencies in rad/s. [A
kind of your own](extend.md) is one more declaration.

Matrices are those of small deviations, $\\dot{{x}} = A x + B u$, $y = C x + D u$; columns of B and
rows of C are the ports in the order of the table, a dq pair being two. They are shown for the
paper's kinds and up to {most} states. $\\omega_{{0}} = 2 \\pi f_0$ in rad/s, $\\Delta\\omega$ is
`delta_omega`, $k_{{P,\\mathrm{{pll}}}}$ is `kP_pll`,
$J = \\begin{{bmatrix}} 0 & -1 \\\\ 1 & 0 \\end{{bmatrix}}$. $e_{{\\mathrm{{eq}},d}}$,
$e_{{\\mathrm{{eq}},q}}$ and the like are the steady-state signal at that port: of the whole
operating point under `--equilibrium exact`; under `--equilibrium paper` the value given as "in the
paper's setting". $\\delta$ in the matrices is the steady-state angle of the controller frame.

Thick lines in the pictures carry a dq pair, thin ones a scalar.
"""


#: Matrices of kinds beyond the paper's are shown up to this number of states.
_MOST_STATES = 4


def modules_page(kinds: Sequence[ModuleKind]) -> str:
    """Markdown: a table by family, then every kind in full."""
    families: dict[str, list[ModuleKind]] = {}
    for kind in kinds:
        families.setdefault(kind.family, []).append(kind)
    paper = sum(not kind.extended for kind in kinds)
    parts = [_TOP.format(count=len(kinds), paper=paper, most=_MOST_STATES)]
    parts += [_overview(family, members) for family, members in families.items()]
    parts += ["\n".join(_section(kind)) for members in families.values() for kind in members]
    return "\n".join(parts)


def _overview(family: str, kinds: Sequence[ModuleKind]) -> str:
    rows = "".join(
        f"| [`{kind.name}`](#{kind.name.lower()}){'+' if kind.extended else ''} | "
        f"{_ports(kind.inputs)} | "
        f"{_ports(kind.outputs)} | {kind.order} | "
        f"{', '.join(f'`{name}`' for name in kind.parameters)} |\n"
        for kind in kinds
    )
    head = "| kind | inputs | outputs | order | parameters |\n| --- | --- | --- | --- | --- |\n"
    return f"**{family[:1].upper()}{family[1:]}**\n\n{head}{rows}"


def _section(kind: ModuleKind) -> Iterator[str]:
    yield f"## {kind.name}\n"
    where = "not in the paper" if kind.extended else "of the paper"
    yield f"{kind.family[:1].upper()}{kind.family[1:]}, {where}. Source: {_plain(kind.reference)}.\n"
    yield f"<!-- block {kind.name} -->\n\n{law(kind)}\n"
    if kind.states:
        yield f"- states: {', '.join(f'`{name}`' for name in kind.states)}"
    if kind.equilibrium_ports or kind.uses_frame:
        yield f"- in the paper's setting: {_paper(kind)}"
    if kind.delay:
        yield (
            "- exact in frequency responses and fits; a Pade form in exported matrices; counts as "
            "order 2"
        )
    if kind.large_signal is not None:
        yield "- has a large-signal law for the nonlinear export"
    yield ""
    if kind.parameters:
        yield "| parameter | unit | bounds | typical | meaning |\n| --- | --- | --- | --- | --- |"
        yield from (_parameter(name, box) for name, box in kind.parameters.items())
        yield ""
    if not kind.delay and (not kind.extended or len(kind.states) <= _MOST_STATES):
        yield from (f"```math\n{matrix}\n```\n" for matrix in matrices(kind))


def _paper(kind: ModuleKind) -> str:
    words = [f"steady-state `{port}` is ({value}, 0)" for port, value in kind.equilibrium.items()]
    fitted = kind.paper_parameters
    return "; ".join(words + ([f"{', '.join(fitted)} fitted at every point"] if fitted else []))


def _parameter(name: str, box: Range) -> str:
    return (
        f"| `{name}` | {box.unit} | {box.low:g} to {box.high:g} | {box.typical:g} | "
        f"{_plain(box.meaning)} |"
    )


def matrices(kind: ModuleKind) -> list[str]:
    """LaTeX of those that are not empty, "A = ..", in symbols."""
    names = {name: Formula(name) for name in kind.parameters}
    frame = (Formula("cos_delta"), Formula("sin_delta"))
    ports = {
        port: (Formula(f"{port}_eq_d"), Formula(f"{port}_eq_q")) for port in kind.equilibrium_ports
    }
    found = kind.state_space(**names, **kind.context(Formula("omega_0"), frame, ports))
    return [
        f"{label} = {_matrix(rows)}"
        for label, rows in zip("ABCD", found, strict=True)
        if len(rows) and len(rows[0])
    ]


def _matrix(rows: Sequence[Sequence[Any]]) -> str:
    cells = [[expression(formula(entry).text) for entry in row] for row in rows]
    if len(cells) > 1 and all(cell == "0" for row in cells for cell in row):
        return rf"0_{{{len(cells)} \times {len(cells[0])}}}"
    inner = " \\\\\n".join(" & ".join(row) for row in cells)
    return f"\\begin{{bmatrix}}\n{inner}\n\\end{{bmatrix}}"


def _ports(ports: Mapping[str, Signal]) -> str:
    return ", ".join(
        f"*{_plain(name)}*" if signal.width == 2 else f"{_plain(name)}"
        for name, signal in ports.items()
    )


def _plain(words: str) -> str:
    """Words in which nothing is Markdown."""
    for mark in ("_", "*", "|"):
        words = words.replace(mark, f"\\{mark}")
    return words
