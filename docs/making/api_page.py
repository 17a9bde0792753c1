"""The pages about the Python interface: which names are public, by the part of the package that
owns them.
"""

from importlib import import_module
from inspect import isclass, isfunction

import ibrid

#: Parts of the package with names of their own beside those of `ibrid`, and what is there to extend
#: them with.
PARTS = {
    "ibrid.measurement": "Measurement",
    "ibrid.modules": "Modules",
    "ibrid.structure": "Diagrams",
    "ibrid.fit": "Fit settings",
    "ibrid.study": "Study",
    "ibrid.evaluation": "Evaluation",
    "ibrid.plants": "Reference inverters",
    "ibrid.devices": "Devices that are model files",
    "ibrid.gap": "Gap",
    "ibrid.parts": "Control practice",
    "ibrid.analysis": "Prediction and stability",
    "ibrid.generic": "Generic planning models",
    "ibrid.export": "Export",
    "ibrid.report": "Pages",
    "ibrid_search": "Search",
    "ibrid.arguments": "What public functions take",
    "ibrid.testing": "Tests of one's own declarations",
}
#: Public though no package lists them, or passed on: what a declaration or a proposer of one's own
#: is written with.
FURTHER = {
    "ibrid.gap": (
        "ibrid.gap.results.gap.Gap",
        "ibrid.gap.results.gap.NamedEffect",
    ),
    "ibrid.testing": ("ibrid.testing.check_proposer",),
    "ibrid_search": (
        "ibrid_search.proposal.Proposer",
        "ibrid_search.proposal.TakesPart",
        "ibrid_search.proposal.Origin",
        "ibrid_search.proposal.Context",
        "ibrid_search.proposal.Proposal",
    ),
}

_TOP = """\
# Python

Made from the public names and their docstrings by `python docs/making/write_pages.py`. Errors that
a caller can fix are `ibrid.IbridError`, one sentence each.
"""


def api_index() -> str:
    """Markdown: each part of the package, what it is about, and the names on its page."""
    rows = "".join(
        f"\n## [{title}](api/{file_of(part)})\n\n`{part}`: {_words(part)}\n\n{_names(part)}\n"
        for part, title in PARTS.items()
    )
    contents = "\n".join(
        f"{title} <api/{file_of(part).removesuffix('.md')}>" for part, title in PARTS.items()
    )
    return f"{_TOP}{rows}\n```{{toctree}}\n:hidden:\n\n{contents}\n```\n"


def api_page(part: str) -> str:
    """Markdown: what a part of the package exports."""
    names = "\n".join(
        f"```{{eval-rst}}\n.. {_directive(name)}\n```\n" for name in public_names(part)
    )
    return f"# {PARTS[part]}\n\n`{part}`: {_words(part)}\n\n{names}"


def file_of(part: str) -> str:
    """File name of a part's page, in the folder `api`."""
    return f"{part.removeprefix('ibrid.')}.md"


def _words(part: str) -> str:
    first, *_ = (import_module(part).__doc__ or "").split("\n\n")
    return " ".join(first.split()).removeprefix(f"{part}: ")


def _names(part: str) -> str:
    return ", ".join(f"`{name.rpartition('.')[2]}`" for name in public_names(part))


def public_names(part: str) -> list[str]:
    """Dotted names under which a part's objects are imported, the shortest one of each, without
    repetition.
    """
    short = {name for name, home in ibrid.HOMES.items() if f"{home}.".startswith(f"{part}.")}
    package = import_module(part)
    own = {
        name for name in getattr(package, "__all__", ()) if _belongs(getattr(package, name), part)
    }
    if part == "ibrid.modules":
        short |= {"Signal", "IbridError"}
    names = [f"ibrid.{name}" for name in sorted(short, key=_alphabetical)]
    names += [f"{part}.{name}" for name in sorted(own - short, key=_alphabetical)]
    return [*names, *FURTHER.get(part, ())]


def _alphabetical(name: str) -> tuple[str, str]:
    return name.lower(), name


def _belongs(found: object, part: str) -> bool:
    """False for what a package passes on from another."""
    home = getattr(found, "__module__", None)
    return not isinstance(home, str) or home.startswith(part)


def _directive(name: str) -> str:
    home, _, last = name.rpartition(".")
    found = getattr(import_module(home), last)
    if isclass(found):
        options = "\n   :members:" if not issubclass(found, Exception) else ""
        return f"autoclass:: {name}{options}"
    return f"autofunction:: {name}" if isfunction(found) else f"autodata:: {name}\n   :no-value:"
