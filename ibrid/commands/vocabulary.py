"""`ibrid modules [KIND]`: the vocabulary as a table, or one kind in full; `ibrid list`: what else
ships.
"""

from argparse import Namespace
from collections.abc import Mapping
from textwrap import shorten
from typing import TYPE_CHECKING

from ibrid.commands.outputs import give_json, require_json_place
from ibrid.streams import complain
from ibrid.writing import aligned

if TYPE_CHECKING:
    from ibrid.modules.kind import ModuleKind
    from ibrid.signals import Signal


def run_list(arguments: Namespace) -> int:
    """Print names and what they are."""
    require_json_place(arguments.json)
    if not give_json(found := shipped(), arguments.json):
        for title, names in found.items():
            rows = ((name, shorten(words, 80, placeholder=" ...")) for name, words in names.items())
            print(f"{title.replace('_', ' ')}:\n{aligned(rows, '  ')}\n")
    return 0


def shipped() -> dict[str, dict[str, str]]:
    """Sort -> name -> what it is, of all that ships."""
    from ibrid.plants.benchmarks import benchmarks
    from ibrid.plants.published import PLANTS
    from ibrid.structure.diagrams.library import published_names, textbook_names, textbook_text

    sorts = {"textbook_diagrams": textbook_names(), "published_controls": published_names()}
    return {
        **{
            sort: {name: " ".join(textbook_text(name).split('"""')[1].split()) for name in names}
            for sort, names in sorts.items()
        },
        "sweeps": {
            name: sweep.open().readline().partition("; ")[2].strip()
            for name, sweep in benchmarks().items()
        },
        "inverters": {name: plant.summary for name, plant in PLANTS.items()},
    }


def run(arguments: Namespace) -> int:
    """Print the table, or everything about one kind."""
    from ibrid.modules.in_full import kind_in_full
    from ibrid.modules.vocabulary import find_kind
    from ibrid.plugins import extended_vocabulary, listed_plugins

    kinds = extended_vocabulary(complain)
    if arguments.kind is None:
        print(
            "\n".join([vocabulary_table(kinds), *(f"Plug-in {line}" for line in listed_plugins())])
        )
        return 0
    same = [kind.name for kind in kinds if kind.name.casefold() == arguments.kind.casefold()]
    print(kind_in_full(find_kind(same[0] if len(same) == 1 else arguments.kind, kinds)))
    return 0


def vocabulary_table(kinds: "tuple[ModuleKind, ...]") -> str:
    """Kinds by family: ports, order, parameters with their boxes; extended kinds carry a +."""
    rows = [("kind", "inputs -> outputs", "order", "parameters [box]")]
    families: dict[str, list[int]] = {}
    for kind in kinds:
        families.setdefault(kind.family, []).append(len(rows))
        boxes = ", ".join(
            f"{name} [{box.low:g}, "
            f"{box.high:g}]{'' if box.unit in ('pu', '1', '') else f' {box.unit}'}"
            for name, box in kind.parameters.items()
        )
        ports = f"{_ports(kind.inputs)} -> {_ports(kind.outputs)}".strip()
        rows.append(
            (kind.name + ("+" if kind.extended else ""), ports, str(kind.order), boxes or "-")
        )
    table = aligned(rows, "  ").splitlines()
    lines = [table[0]]
    for family, members in families.items():
        lines += ["", family, *(table[member] for member in members)]
    lines += [
        "",
        "Ports with a colon carry a dq pair, the others a scalar. + is beyond the paper's 23: "
        "--vocabulary extended.",
        "Parameters are per unit unless a unit is given. `ibrid modules KIND` tells all of one "
        "kind.",
    ]
    return "\n".join(lines)


def _ports(ports: "Mapping[str, Signal]") -> str:
    return " ".join(name + (":" if signal.width == 2 else "") for name, signal in ports.items())
