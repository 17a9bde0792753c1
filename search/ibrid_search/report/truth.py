"""The diagram that a user gives as the truth, fitted to the same data with the same options as what was found."""

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import Sweep
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program

#: Settings of the found record that the truth is fitted with as well; the effort is that of `ibrid evaluate`.
SAME = ("parameters", "equilibrium", "objective", "seed")


def given_truth(program: str, sweep: Sweep | None, found: Record | None) -> tuple[Diagram | None, Record | None, str]:
    """Diagram and record of the truth, and a sentence when one of them cannot be had; nothing at all for no program."""
    if not program.strip():
        return None, None, ""
    try:
        diagram = parse_program(program, "the given truth")
    except IbridError as problem:
        return None, None, str(problem)
    if sweep is None or found is None:
        return diagram, None, ""
    options = {name: found.settings[name] for name in SAME if name in found.settings}
    fitted = found.settings.get("fitted_points", sweep.names)
    held = [name for name in sweep.names if name not in fitted]
    try:
        record = evaluate(diagram, sweep, vocabulary=found.vocabulary, holdout_op=held, **options)
    except IbridError as problem:
        return diagram, None, f"The given truth is not fitted: {problem}"
    if record.nrmse is None:
        return diagram, None, f"The given truth has no fit ({record.outcome}): {'; '.join(record.reasons)}"
    return diagram, record, ""
