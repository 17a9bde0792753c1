"""An edit as a value, between diagrams whose modules have numbers: taken from two diagrams, and
made in one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid_policy.numbering import OUTER, Numbered, Port, Slot, numbered
from ibrid_policy.tokens import LanguageError


@dataclass(frozen=True)
class Rewiring:
    """An input, the outputs that no longer drive it, and those that now do; in the order of their
    numbers.
    """

    target: Port
    cut: tuple[Port, ...] = ()
    wired: tuple[Port, ...] = ()


@dataclass(frozen=True)
class NumberedEdit:
    """What changes in a diagram of n modules.

    `swapped` : (module, new kind), its wires kept where the ports have the same names. `removed` :
    modules, their wires too.
    `added` : kinds of new modules, numbered from n. `rewired` : inputs whose sources change, new
    modules' first, then i_DQ, then the others. `owners` : free parameter -> the one whose value it
    takes, for those that change; itself: its own.
    """

    swapped: tuple[tuple[int, str], ...] = ()
    removed: tuple[int, ...] = ()
    added: tuple[str, ...] = ()
    rewired: tuple[Rewiring, ...] = ()
    owners: Mapping[Slot, Slot] | None = None


def exchangeable(kind: ModuleKind, other: ModuleKind) -> bool:
    """True for kinds of which one can take the other's place: both are filters with a command, or
    they share an input and have the same outputs.
    """
    if kind.name == other.name:
        return False
    if is_plant(kind) or is_plant(other):
        return is_plant(kind) and is_plant(other)
    alike = {port for port, signal in kind.inputs.items() if other.inputs.get(port) is signal}
    return bool(alike) and dict(kind.outputs) == dict(other.outputs)


def is_plant(kind: ModuleKind) -> bool:
    """True for a filter that a controller commands."""
    return "u_r" in kind.inputs


def input_order(view: Numbered, total: int) -> list[int]:
    """Modules in the order in which an edit visits their inputs: new ones, the terminal, old
    ones.
    """
    old = len(view.kinds)
    return [*range(old, total), OUTER, *range(old)]


def kept_ports(kind: ModuleKind, other: ModuleKind) -> set[str]:
    """Ports that keep their wires when `other` takes the place of `kind`."""
    before = {**kind.inputs, **kind.outputs}
    return {
        port
        for port, signal in {**other.inputs, **other.outputs}.items()
        if before.get(port) is signal
    }


def after_structure(
    view: Numbered, swapped: Mapping[int, ModuleKind], removed: frozenset[int] | set[int]
) -> dict[Port, list[Port]]:
    """What drives each input of the modules that stay, once some are exchanged and some are
    gone.
    """
    kept = {number: kept_ports(view.kinds[number], kind) for number, kind in swapped.items()}

    def stays(port: Port) -> bool:
        number, name = port
        return number not in removed and (number not in kept or name in kept[number])

    sources = {
        target: [source for source in found if stays(source)]
        for target, found in view.sources.items()
        if stays(target)
    }
    for number, kind in swapped.items():
        for port in kind.inputs:
            sources.setdefault((number, port), [])
    return sources


def owners_after(
    view: Numbered,
    swapped: Mapping[int, ModuleKind],
    removed: frozenset[int] | set[int],
    added: list[ModuleKind],
) -> dict[Slot, Slot]:
    """Which free parameters share a value after the structure has changed: those left of a group go
    on sharing.
    """
    groups: dict[Slot, list[Slot]] = {}
    for slot, owner in view.owner.items():
        if slot[0] not in removed and slot[0] not in swapped:
            groups.setdefault(owner, []).append(slot)
    found = {slot: group[0] for group in groups.values() for slot in group}
    fresh = {**swapped, **{len(view.kinds) + index: kind for index, kind in enumerate(added)}}
    for number, kind in fresh.items():
        found |= {(number, name): (number, name) for name in kind.parameters}
    return found


def difference(
    parent: Numbered, child: Diagram, vocabulary: Vocabulary, *, equilibrium: str = "exact"
) -> NumberedEdit:
    """The edit that makes `child` of `parent`: modules of the same name are the same module.

    Raises LanguageError when it would have to change fixed numbers or boxes.
    """
    known = {kind.name: kind for kind in vocabulary}
    target = numbered(child, vocabulary, equilibrium=equilibrium)
    kept: dict[int, int] = {}  # number in the child -> number in the parent
    swapped: dict[int, ModuleKind] = {}
    for number, name in enumerate(target.names):
        before = parent.place.get(name)
        if before is None:
            continue
        if parent.kinds[before].name == target.kinds[number].name:
            kept[number] = before
            _require_values(parent, before, target, number)
        elif exchangeable(parent.kinds[before], target.kinds[number]):
            kept[number], swapped[before] = before, known[target.kinds[number].name]
    removed = set(range(len(parent.kinds))) - set(kept.values())
    fresh = [number for number in range(len(target.kinds)) if number not in kept]
    for number in [*fresh, *(number for number, before in kept.items() if before in swapped)]:
        if any(
            isinstance(one, float | tuple) for one in target.instances[number].bindings.values()
        ):
            raise LanguageError("the policy adds no fixed numbers and no boxes")
    number_of = kept | {number: len(parent.kinds) + index for index, number in enumerate(fresh)}
    added = [target.kinds[number] for number in fresh]

    def moved(port: Port) -> Port:
        return (number_of[port[0]], port[1]) if port[0] != OUTER else port

    before = after_structure(parent, swapped, removed)
    wanted = {moved(port): sorted(map(moved, found)) for port, found in target.sources.items()}
    rewired = []
    order = {
        number: index
        for index, number in enumerate(input_order(parent, len(parent.kinds) + len(added)))
    }
    for port in sorted(
        wanted, key=lambda one: (order[one[0]], _port_index(one, number_of, target))
    ):
        old, new = before.get(port, []), wanted[port]
        cut = tuple(sorted(one for one in old if one not in new))
        wired = tuple(one for one in new if one not in old)
        if cut or wired:
            rewired.append(Rewiring(port, cut, wired))
    now = owners_after(parent, swapped, removed, added)
    groups: dict[Slot, list[Slot]] = {}
    for slot, owner in target.owner.items():
        groups.setdefault(owner, []).append(moved(slot))
    then = {slot: min(group) for group in groups.values() for slot in group}
    return NumberedEdit(
        tuple(sorted((number, kind.name) for number, kind in swapped.items())),
        tuple(sorted(removed)),
        tuple(kind.name for kind in added),
        tuple(rewired),
        {slot: owner for slot, owner in sorted(then.items()) if now.get(slot) != owner},
    )


def made(parent: Numbered, edit: NumberedEdit, vocabulary: Vocabulary) -> Diagram:
    """The diagram after an edit; nothing is tidied and nothing is checked."""
    draft = Draft(parent.diagram, vocabulary)
    names = list(parent.names)
    for number, kind in edit.swapped:
        old = names[number]
        names[number] = draft.replace(old, kind, kind.lower() + "_new")
        plant = is_plant(draft.vocabulary[kind])
        final = _free_name(draft, old if plant else kind.lower())
        draft.rename(names[number], final)
        names[number] = final
    for number in edit.removed:
        draft.remove(names[number])
    names += [draft.add(kind, kind.lower()) for kind in edit.added]

    def end(port: Port) -> str:
        return port[1] if port[0] == OUTER else f"{names[port[0]]}.{port[1]}"

    for one in edit.rewired:
        for source in one.cut:
            draft.disconnect(end(source), end(one.target))
        for source in one.wired:
            draft.connect(end(source), end(one.target))
    kinds = {number: draft.vocabulary[kind] for number, kind in edit.swapped}
    added = [draft.vocabulary[kind] for kind in edit.added]
    owners = owners_after(parent, kinds, set(edit.removed), added) | dict(edit.owners or {})
    _share(draft, names, owners)
    return draft.diagram()


def _free_name(draft: Draft, stem: str) -> str:
    name, number = stem, 2
    while name in draft.instances:
        name, number = f"{stem}_{number}", number + 1
    return name


def _share(draft: Draft, names: list[str], owners: Mapping[Slot, Slot]) -> None:
    """Bind parameters so that exactly those with one owner share a value; names that do so already
    stay.
    """

    def bound(slot: Slot) -> str:
        own = f"{names[slot[0]]}.{slot[1]}"
        value = draft.instances[names[slot[0]]].bindings.get(slot[1], own)
        return value if isinstance(value, str) else own

    groups: dict[Slot, list[Slot]] = {}
    for slot, owner in sorted(owners.items()):
        groups.setdefault(owner, []).append(slot)
    users: dict[str, set[Slot]] = {}
    for slot in owners:
        users.setdefault(bound(slot), set()).add(slot)
    for members in groups.values():
        shared = {bound(slot) for slot in members}
        if len(shared) == 1 and users[shared.pop()] == set(members):
            continue
        for number, parameter in members:
            if isinstance(draft.instances[names[number]].bindings.get(parameter), str):
                draft.unbind(names[number], parameter)
        (first, lent), *others = members
        for number, parameter in others:
            draft.bind(names[number], **{parameter: f"{names[first]}.{lent}"})


def _port_index(port: Port, number_of: Mapping[int, int], target: Numbered) -> int:
    if port[0] == OUTER:
        return 0
    number = next(one for one, other in number_of.items() if other == port[0])
    return list(target.kinds[number].inputs).index(port[1])


def _require_values(parent: Numbered, before: int, child: Numbered, number: int) -> None:
    def fixed(view: Numbered, at: int) -> dict:
        bindings = view.instances[at].bindings
        known = view.kinds[at].parameters
        return {
            key: value
            for key, value in bindings.items()
            if key in known and isinstance(value, float | tuple)
        }

    if fixed(parent, before) != fixed(child, number):
        raise LanguageError("the policy changes no fixed numbers and no boxes")
