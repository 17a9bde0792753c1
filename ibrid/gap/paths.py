"""Ways in a diagram: which blocks hand a signal on from one port to another, and in a row before an input."""

from collections.abc import Iterable

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port


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
            if name and name not in seen and draft.kind(name).passes:
                seen.add(name)
                found = behind(f"{name}.in_")
                if found is not None:
                    return (*found, name)
        return None

    return behind(target)


def row_before(draft: Draft, target: str) -> tuple[str, ...]:
    """Filters and delays in a row right before an input, the nearest first, each the only source of the next."""
    row: list[str] = []
    while len(sources := draft.sources(target)) == 1:
        name = split_port(sources[0])[0]
        if not name or name in row or not draft.kind(name).shapes:
            break
        row.append(name)
        target = f"{name}.in_"
    return tuple(row)


def after(draft: Draft, source: str, kind: str, stem: str) -> str:
    """The output of a new block behind a source."""
    name = draft.add(kind, stem)
    draft.connect(source, f"{name}.in_")
    return f"{name}.out"
