"""Ways in a diagram: which blocks hand a signal on from one port to another, and in a row before an input."""

from collections.abc import Iterable

from ibrid.modules.kind import ModuleKind
from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port


def in_line(kind: ModuleKind) -> bool:
    """True for a block of one input in_ and one output out of the same signal."""
    return set(kind.inputs) == {"in_"} and set(kind.outputs) == {"out"} and kind.inputs["in_"] is kind.outputs["out"]


def passes(kind: ModuleKind) -> bool:
    """True for a block in line that hands a signal on at rest: a sign, gain, filter or delay, no integrator, no J."""
    return in_line(kind) and (kind.static or kind.dc_gain is not None) and kind.name != "JMul"


def path(draft: Draft, source: str, target: str, *, without: Iterable[str | None] = ()) -> tuple[str, ...] | None:
    """The blocks that hand a signal on from an output to an input, () for a wire; None where there is no way.

    without : modules through which no way counts.
    """
    seen = set(without)

    def behind(port: str) -> tuple[str, ...] | None:
        if source in draft.sources(port):
            return ()
        for one in draft.sources(port):
            name = split_port(one)[0]
            if name and name not in seen and passes(draft.kind(name)):
                seen.add(name)
                found = behind(f"{name}.in_")
                if found is not None:
                    return (*found, name)
        return None

    return behind(target)


def row_before(draft: Draft, target: str, kinds: Iterable[str]) -> tuple[str, ...]:
    """Blocks of these kinds in a row right before an input, the nearest first, each the only source of the next."""
    row: list[str] = []
    while len(sources := draft.sources(target)) == 1:
        name = split_port(sources[0])[0]
        if not name or name in row or draft.instances[name].kind not in tuple(kinds):
            break
        row.append(name)
        target = f"{name}.in_"
    return tuple(row)


def after(draft: Draft, source: str, kind: str, stem: str) -> str:
    """The output of a new block behind a source."""
    name = draft.add(kind, stem)
    draft.connect(source, f"{name}.in_")
    return f"{name}.out"
