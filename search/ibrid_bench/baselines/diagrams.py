"""Rows of block diagrams: the textbook's, right and wrong, with its parameters fitted, and the one
that the search finds.
"""

from pathlib import Path

from ibrid_bench.baselines.answer import Answer
from ibrid_bench.baselines.case import Case
from ibrid_bench.baselines.recovered import recovered
from ibrid_bench.search.scoring import Rows, Search, fitted, made_before

from ibrid.errors import IbridError
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program


def true_structure(case: Case) -> Answer:
    """The diagram that made the data, from default starts."""
    return _answer(case, case.truth, "the block diagram, known beforehand")


def wrong_structure(case: Case) -> Answer:
    """The same without the filter before the PLL, as somebody without the vendor's documents would
    draw it.
    """
    return _answer(case, case.wrong(), "a block diagram that is not the device's")


def searched(
    case: Case, folder: Path, *, search: Search, budget: int, workers: int, ledger: Rows
) -> Answer:
    """The search from the naive start; `folder` must not exist. Its answer is fitted as the
    textbook's are.

    ledger : of searches that need not be made again.
    """
    row = made_before(case.trial(budget), ledger, folder, search=search, workers=workers)
    program = parse_program(row["answer_program"], "the answer")
    overlap = f"F1 {row['modules_f1']:.2f}/{row['connections_f1']:.2f}"
    return _answer(
        case, program, f"a block diagram from the data alone ({overlap})", row["seconds"]
    )


def _answer(case: Case, diagram: Diagram, reader: str, seconds: float | None = None) -> Answer:
    record = fitted(case.trial(1), case.hidden, diagram)
    if not record.parameters:
        raise IbridError(
            f"{case.name}: the diagram could not be fitted ({'; '.join(record.reasons)})"
        )
    return Answer(
        fitted=[
            record.response(point.op.name, point.frequency) for point in case.hidden.sweep.points
        ],
        elsewhere=[record.response(case.held_out.op.name, case.held_out.frequency)],
        parameters=record.free_parameters,
        order=str(record.order),
        recovered=len(recovered(record, case.truth, case.values)),
        reader=reader,
        seconds=seconds,
    )
