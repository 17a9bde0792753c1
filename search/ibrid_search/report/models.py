"""What was found beside the start and, where it is given, the truth: diagrams, what they are made
of, and responses.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagrams.block_diagram import DrawnDiagrams, Shown, drawn_diagrams, readable
from ibrid.report.facts.parameter_rows import values_or_none
from ibrid.report.figures.bode import Curves, bode_svgs, line_frequency
from ibrid_search.report.run_data import RunData
from ibrid_search.run.selection import Choice

#: Operating points that get figures, and points of a model line: a page stays below a few
#: megabytes.
POINTS = 6
DENSE = 240


@dataclass(frozen=True)
class FittedModel:
    """A line of the figures. `index` : of its colour and dashes."""

    name: str
    record: Record
    index: int


def drawn_models(run: RunData) -> DrawnDiagrams | None:
    """What was found, the start and the truth; None where there is none of them."""
    shown: list[Shown] = [
        Shown(
            title,
            diagram,
            values=values_or_none(None if step is None else run.records.get(step.number)),
        )
        for title, diagram, step in (
            ("Found", None if run.answer is None else readable(run.answer.program), run.answer),
            (
                "The start",
                None if run.start in (None, run.answer) else readable(run.start.program),
                run.start,
            ),
            ("The given truth", run.truth, None),
        )
        if diagram is not None
    ]
    return drawn_diagrams(shown, run.kinds) if shown else None


def response_facts(run: RunData) -> dict[str, Any]:
    """Measured dots and model lines of every entry.

    `points` : by operating point. `left` : those that are not drawn.
    """
    models = _models(run)
    names = list(models[0].record.parameters) if models else []
    return {
        "models": [(model.name, model.index) for model in models],
        "points": [_point_facts(run, models, op, place) for place, op in enumerate(names[:POINTS])],
        "left": names[POINTS:],
    }


def front_rows(run: RunData) -> list[tuple[Choice, str]]:
    """The front: each structure and what it is made of, the lowest error first."""
    front = sorted(
        run.selection.front,
        key=lambda one: (math.inf if one.nrmse is None else one.nrmse, one.step),
    )
    programs = {
        one.step: step.program for one in front if (step := run.steps.get(one.step)) is not None
    }
    return [(one, _made_of(programs.get(one.step, ""), run.kinds)) for one in front]


def _made_of(program: str, kinds: Sequence[ModuleKind]) -> str:
    """Kinds of a program and their number, without what is static."""
    diagram = readable(program)
    families = {kind.name: kind.family for kind in kinds}
    blocks = () if diagram is None else diagram.instances
    used = Counter(block.kind for block in blocks if families.get(block.kind) != "static")
    return ", ".join(kind if number == 1 else f"{number} {kind}" for kind, number in used.items())


def _models(run: RunData) -> list[FittedModel]:
    """Found, start and truth, as far as they were fitted; each keeps its colour."""
    answer, start = run.record, None if run.start is None else run.records.get(run.start.number)
    models = [FittedModel("found", answer, 0)] if answer is not None and answer.parameters else []
    if start is not None and start.parameters and start is not answer:
        models.append(FittedModel("start", start, 3))
    if run.truth_record is not None:
        models.append(FittedModel("given truth (refitted)", run.truth_record, 1))
    return models


def _point_facts(run: RunData, models: list[FittedModel], op: str, place: int) -> dict[str, Any]:
    point = run.sweep.point(op) if run.sweep is not None and op in run.sweep.names else None
    lines, problems = [], []
    for number, model in enumerate(models):
        try:
            low, high = model.record.settings["frequency_hz"]
            frequency = line_frequency(model.record, op, (low, high), point, DENSE)
            dots, response = point if number == 0 else None, model.record.response(op, frequency)
            lines.append(Curves(model.name, model.index, dots, frequency, response))
        except IbridError as problem:
            problems.append((model.name, problem))
    label = f" at {op}: measured, {', '.join(line.name for line in lines)}."
    return {
        "op": op,
        "held_out": op in models[0].record.holdout,
        "errors": [
            (model.name, value)
            for model in models
            if (value := {**model.record.nrmse_by_op, **model.record.holdout}.get(op)) is not None
        ],
        "problems": problems,
        "bode": bode_svgs(lines, f"bode-{place}", label) if lines else None,
    }
