"""The vocabulary of control and plant modules, each declared once as a frozen value."""

from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY, choose_vocabulary, find_kind

__all__ = [
    "PAPER_VOCABULARY",
    "VOCABULARY",
    "ModuleKind",
    "Range",
    "choose_vocabulary",
    "find_kind",
]
