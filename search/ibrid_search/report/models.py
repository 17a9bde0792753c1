"""What was found beside the start and, where it is given, the truth: diagrams, comparison and frequency response."""

from dataclasses import dataclass

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import PointSweep
from ibrid.report.bode import Curves, bode_figures, line_frequency
from ibrid.report.diagrams_beside import Shown, diagrams_beside, readable
from ibrid.report.legend import models_legend
from ibrid.report.markup import cell, escape, head, paragraph, row, table
from ibrid.report.numbers import error
from ibrid.structure.compare import Comparison
from ibrid_search.report.run_data import RunData

#: Operating points that get figures, and points of a model line: a page stays below a few megabytes.
POINTS = 6
DENSE = 240


@dataclass(frozen=True)
class _Model:
    """A line of the figures. `index` : of its colour and dashes."""

    name: str
    record: Record
    index: int


def diagrams_html(run: RunData) -> str:
    """The start, what was found and the truth, beside each other where there is room."""
    shown: list[Shown] = [
        (words, diagram, ())
        for words, diagram in (
            ("The start", None if run.start is None else readable(run.start.program)),
            ("Found", None if run.answer is None else readable(run.answer.program)),
            ("The given truth", run.truth),
        )
        if diagram is not None
    ]
    if not shown:
        return paragraph("There is no diagram to draw yet.")
    return diagrams_beside(shown, run.kinds)


def comparison_html(found: Comparison) -> str:
    """What the found diagram has in common with the given truth, up to naming and canonical rewriting."""
    rows = [
        row(name, [*(cell(f"{value:.3f}", numeric=True) for value in (one.precision, one.recall, one.f1)),
                   cell(f"{one.common} / {one.first} / {one.second}", numeric=True)])
        for name, one in (("modules", found.modules), ("connections", found.connections))
    ]  # fmt: skip
    names = ["", "precision", "recall", "F1", "common / found / true"]
    words = (
        "Modules and connections are matched up to naming; signs, fixed gains, slices and packs belong to connections."
    )
    shown = table("Comparison", words, head(names, numeric=(1, 2, 3, 4)) + f"<tbody>{''.join(rows)}</tbody>")
    verdict = (
        "The found structure is the given one." if found.same else "The found structure differs from the given one."
    )
    matched = "; ".join(f"{a} = {b}" for a, b in found.matched)
    lines = [f"Matched, found = true: {matched}."] if matched else []
    lines += [f"Only found: {', '.join(found.only_first)}."] if found.only_first else []
    lines += [f"Only in the truth: {', '.join(found.only_second)}."] if found.only_second else []
    return paragraph(verdict) + shown + "".join(paragraph(line, "note") for line in lines)


def response_html(run: RunData) -> str:
    """Measured dots and model lines of every entry, operating point by operating point."""
    models = _models(run)
    if not models:
        return paragraph("No candidate has been fitted yet.")
    names = list(models[0].record.parameters)
    held = set(models[0].record.holdout)
    shown = "".join(_point_html(run, models, op, index, op in held) for index, op in enumerate(names[:POINTS]))
    left = names[POINTS:]
    note = paragraph(f"Not drawn: {', '.join(left)}.", "note") if left else ""
    words = "Admittance per unit, current out of the inverter."
    return paragraph(words, "note") + _legend(models, run.sweep is not None) + shown + note


def _models(run: RunData) -> list[_Model]:
    """Found, start and truth, as far as they were fitted; each keeps its colour."""
    answer, start = run.record, run.records.get(0)
    found = [_Model("found", answer, 0)] if answer is not None and answer.parameters else []
    if start is not None and start.parameters and (run.answer is None or run.answer.number != 0):
        found.append(_Model("start", start, 3))
    if run.truth_record is not None:
        found.append(_Model("given truth (refitted)", run.truth_record, 1))
    return found


def _point_html(run: RunData, models: list[_Model], op: str, place: int, held: bool) -> str:
    point = run.sweep.point(op) if run.sweep is not None and op in run.sweep.names else None
    shown, notes = [], []
    for number, model in enumerate(models):
        try:
            shown.append(_curves(model, op, point if number == 0 else None, point))
        except IbridError as problem:
            notes.append(f"No line of {model.name}: {problem}")
    errors = ", ".join(
        f"{model.name} {error(value)}"
        for model in models
        if (value := {**model.record.nrmse_by_op, **model.record.holdout}.get(op)) is not None
    )
    words = f"NRMSE: {errors}." + (" Held out: predicted, not fitted." if held else "")
    label = f" at {op}: measured, {', '.join(one.name for one in shown)}."
    return (
        f"<h3>{escape(op)}</h3>{paragraph(words, 'note')}"
        + "".join(paragraph(note, "bad") for note in notes)
        + (bode_figures(shown, f"bode-{place}", label) if shown else "")
    )


def _curves(model: _Model, op: str, dots: PointSweep | None, point: PointSweep | None) -> Curves:
    low, high = model.record.settings["frequency_hz"]
    frequency = line_frequency(model.record, op, (low, high), point, DENSE)
    return Curves(model.name, model.index, dots, frequency, model.record.response(op, frequency))


def _legend(models: list[_Model], measured: bool) -> str:
    """Circle for the measurement, a line as in the figures for each model."""
    return models_legend([(model.name, model.index) for model in models], 0 if measured else None)
