"""The answer of a run and the rivals that its data leave open, as records."""

from collections.abc import Sequence
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.writing import inside
from ibrid_search.report.selection import read_selection
from ibrid_search.run_folder import ARCHIVE, SELECTION
from ibrid_search.store import Store


def open_structures(
    folder: Path, vocabulary: str | Sequence[ModuleKind] = VOCABULARY
) -> tuple[tuple[str, ...], tuple[Record, ...]]:
    """Hashes of structures and their records, the answer first; IbridError where the run has not ended or is damaged."""
    selection = read_selection(inside(folder, SELECTION))
    if selection is None or selection.answer is None:
        raise IbridError(f"{folder}: the search has no answer yet; finish it with ibrid search ... --resume")
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        steps = [store.step(number) for number in (selection.answer, *selection.rival_steps)]
        records = tuple(store.record(step.number, vocabulary) for step in steps)
    return tuple(str(step.hash) for step in steps), records
