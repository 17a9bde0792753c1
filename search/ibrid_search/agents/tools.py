"""The tools of an agent that change nothing: records, residuals, steps, comparison, prediction,
grammar, vocabulary. Text is read, never run; every answer names the next useful call.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.models.prediction import predict
from ibrid.errors import IbridError, ProgramError, near
from ibrid.evaluation.errors_by_part import nrmse
from ibrid.evaluation.grade import judged_points
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.amplitudes import evenly
from ibrid.measurement.sweeps.sweep import ENTRIES
from ibrid.modules.in_full import kind_in_full
from ibrid.modules.vocabulary import find_kind
from ibrid.report.look.numbers import number
from ibrid.structure.comparison.compare import compare
from ibrid.structure.compiling.check import Violation, examine
from ibrid.structure.compiling.compiled import compile_diagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import LONGEST_PROGRAM, parse_program
from ibrid.study import Study
from ibrid.writing import PlainData
from ibrid_search.agents.insight import Insight
from ibrid_search.agents.tool import Steps, Tool, left_out, tools_in
from ibrid_search.blocks import shown
from ibrid_search.language_models.language import api_text, kinds_text, rules_text
from ibrid_search.language_models.record_view import polar, record_view, summary
from ibrid_search.step import Step, line

#: Candidates that list_best gives at most, and without being asked for a number.
MOST_LISTED, LISTED = 20, 5
#: Rows of a prediction; steps and frequencies that are shown at most, and parameters that moved.
PREDICTED, STEPS, ROWS, MOVED = 12, 20, 16, 12
#: Relative change of a parameter from which it counts as moved.
CHANGED = 0.02


class Tools:
    """The tools over what was evaluated so far under one study; `workbench` adds those that
    evaluate and finish.

    `hand_in` : what an agent does with a program that it believes in, for the next call that
    answers name.
    `answer_within` : seconds after which an answer comes with what is there; None for whole
    answers.
    """

    def __init__(
        self,
        study: Study,
        steps: Steps,
        hand_in: str = "submit_edit",
        answer_within: float | None = None,
    ) -> None:
        self.study, self.steps, self.hand_in = study, steps, hand_in
        self.insight = Insight(study, steps, hand_in, answer_within)

    @property
    def reading(self) -> tuple[Tool, ...]:
        """Tools that evaluate nothing."""
        own = tools_in(
            "tools.toml",
            self,
            longest_program=LONGEST_PROGRAM,
            most_listed=MOST_LISTED,
            listed=LISTED,
        )
        return (*self.insight.tools, *own)

    def show_record(
        self, step: int, op: str | None = None, band: str | None = None, entry: str | None = None
    ) -> PlainData:
        """`ibrid_search.language_models.record_view` of a step."""
        view = record_view(self.steps.record(step), self.study.sweep, op=op, band=band, entry=entry)
        return {"step": step, "next": f"show_residuals or diagnose with step={step}", **view}

    def show_residuals(self, step: int, op: str | None = None) -> PlainData:
        """What a step leaves at an operating point in standard deviations of the noise, |model -
        measured| / (sqrt(2) sigma), by frequency and entry; parts that stand out are those of the
        record's `misfit`.
        """
        record = self.steps.record(step)
        names = tuple(record.nrmse_by_op)
        if op is not None and op not in names:
            raise IbridError(
                f"the fitted data have no operating point {op[:60]!r}; {near(op[:60], names)}"
            )
        points, source = judged_points([self.study.fitted.point(name) for name in names])
        point = points[names.index(op) if op else 0]
        difference = np.abs(record.response(point.op.name, point.frequency) - point.admittance)
        left = difference / (np.sqrt(2) * np.asarray(point.sigma))
        chosen, misfit = evenly(len(left), ROWS), record.misfit or {}
        parts = list(misfit.get("by_entry_band", ()))[:ROWS]
        return {
            "step": step,
            "op": point.op.name,
            "sigma_from": source if source != "unknown" else "unknown: taken as 1e-4 of |Y|",
            "chi2_per_dof": misfit.get("chi2_per_dof"),
            "stand_out": [
                f"{one['z']:.0f} sigma: {one['entry']} at {one['band']} Hz, {one['op']}"
                for one in parts
            ],
            "rows": [
                {"hz": round(float(point.frequency[k]), 2)}
                | {entry: round(float(left[k][place]), 1) for entry, place in ENTRIES.items()}
                for k in chosen
            ],
            **left_out("rows", len(chosen), len(left)),
            "next": f"diagnose with step={step}"
            if parts
            else f"nothing stands out; {self._done(step)}",
        }

    def list_steps(self, after: int = -1) -> PlainData:
        """Steps with a number above `after` in their order, refused ones too: parent, note and how
        they ended.
        """
        best = self.steps.best(1)
        there = [step for step in self.steps.steps if step.number > after]
        told = [_told(step) for step in there[:STEPS]]
        if left := left_out("steps", len(told), len(there)):
            left["go_on_after"] = told[-1]["step"]
        return {"steps": told, **left} | (
            {"best": best[0].step, "next": f"diagnose with step={best[0].step}"} if best else {}
        )

    def list_best(self, count: int = LISTED) -> PlainData:
        """The best steps; their programs are read by read_diagram."""
        best = self.steps.best(count)
        known = {step.number: step for step in self.steps.steps}
        ways = ([step.number for step in line(known, one.step)] for one in best)
        rows = [
            {"step": one.step, **summary(one.record), "lineage": way}
            for one, way in zip(best, ways, strict=True)
        ]
        return {"best": rows} | (
            {"next": f"show_residuals or diagnose with step={best[0].step}"} if best else {}
        )

    def predict_point(self, step: int, op: str) -> PlainData:
        """Error at a held-out point, or rows of a prediction."""
        record, sweep = self.steps.record(step), self.study.sweep
        measured = sweep.point(op) if op in sweep.names else None
        frequency = (measured or sweep.points[0]).frequency
        prediction = predict(record, op, frequency)
        chosen = evenly(len(frequency), PREDICTED)
        answer: PlainData = {
            "step": step,
            "op": prediction.op.name,
            "stable": prediction.stable,
            "warnings": list(prediction.warnings),
        }
        if measured is not None:
            fitted = op in record.settings["fitted_points"]
            answer |= {"nrmse": nrmse(prediction.admittance, measured), "fitted": fitted}
        band = prediction.relative_band
        return answer | {
            "relative_band_95": None if band is None else float(band.max()),
            "rows": [
                {"hz": round(float(frequency[k]), 2)}
                | {
                    entry: polar(complex(prediction.admittance[k][place]))
                    for entry, place in ENTRIES.items()
                }
                for k in chosen
            ],
            **left_out("rows", len(chosen), len(frequency)),
            "next": self._done(step),
        }

    def check_grammar(self, program: str) -> PlainData:
        """Violations and warnings, and the size of what is legal."""
        try:
            diagram = parse_program(program)
        except ProgramError as error:
            return {"legal": False, "violations": [{"line": None, "message": str(error)}]}
        compiled = compile_diagram(diagram, self.study.kinds, equilibrium=self.study.equilibrium)
        if compiled.violations:
            return {
                "legal": False,
                "violations": sentences(compiled.violations),
                "next": "check_grammar with what mends them",
            }
        met = self.steps.met(diagram)
        return {
            "legal": True,
            "warnings": sentences(compiled.warnings),
            "modules": len(diagram.instances),
            "order": sum(kind.order for kind in compiled.wiring.kinds.values()),
            "free_parameters": len(compiled.parameter_table.free),
            "met_before": met,
            "next": f"try_programs, or {self.hand_in}" if met is None else "another program",
        }

    def describe_vocabulary(self, part: str = "language", kind: str | None = None) -> PlainData:
        """The language with the names of the kinds, all kinds in a line each, or one in full."""
        kinds, equilibrium = self.study.kinds, self.study.equilibrium
        if kind is not None:
            return {
                "kind": kind,
                "lines": kind_in_full(find_kind(kind, kinds)).splitlines(),
                "next": "check_grammar",
            }
        if part == "kinds":
            return {"kinds": kinds_text(kinds, equilibrium, short=True), "next": "check_grammar"}
        return {
            "language": api_text(),
            "rules": rules_text(kinds, equilibrium),
            "kinds": ", ".join(one.name for one in kinds),
            "next": "describe_vocabulary with part=kinds, or kind=NAME",
        }

    def compare(self, a: str | int, b: str | int) -> PlainData:
        """`ibrid compare` of two legal programs; of two steps also what changed in numbers."""
        comparison = compare(self._legal(a, "a"), self._legal(b, "b"), self.study.kinds)
        answer: PlainData = {
            "same": comparison.same,
            "f1_modules": comparison.modules.f1,
            "f1_connections": comparison.connections.f1,
            "only_a": list(comparison.only_first),
            "only_b": list(comparison.only_second),
        }
        if isinstance(a, int) and isinstance(b, int):
            answer |= differences(self.steps.record(a), self.steps.record(b))
        best = self.steps.best(1)
        return answer | ({"next": f"diagnose with step={best[0].step}"} if best else {})

    def _done(self, step: int) -> str:
        """What follows when a step leaves nothing to explain."""
        if self.hand_in == "evaluate_program":
            return f"finish with step={step}"
        return f"take away what step {step} can do without"

    def _legal(self, program: str | int, name: str) -> Diagram:
        if isinstance(program, int):
            return self.steps.record(program).diagram
        diagram = parse_program(program, name)
        if found := examine(diagram, self.study.kinds, equilibrium=self.study.equilibrium)[0]:
            raise IbridError(f"{name} is not legal: {found[0]}; check_grammar tells all of it")
        return diagram


def _told(step: Step) -> PlainData:
    ended: PlainData = {"step": step.number, "status": str(step.status)}
    if step.parent is not None:
        ended["parent"] = step.parent
    if step.note:
        ended["note"] = shown(step.note)
    if step.nrmse is not None:
        ended |= {"nrmse": step.nrmse, "free": step.free} | (
            {} if step.stable else {"stable": False}
        )
    return ended | ({"same_as": step.same_as} if step.same_as is not None else {})


def differences(first: Record, second: Record) -> PlainData:
    """What the second of two fits has better or worse than the first: error, size, and parameters
    that moved.
    """
    pairs = {
        "nrmse": (first.nrmse, second.nrmse),
        "free_parameters": (first.free_parameters, second.free_parameters),
        "order": (first.order, second.order),
        **{
            f"nrmse {band} Hz": (first.nrmse_by_band.get(band), second.nrmse_by_band.get(band))
            for band in first.nrmse_by_band
        },
        **{
            f"nrmse {entry}": (first.nrmse_by_entry.get(entry), second.nrmse_by_entry.get(entry))
            for entry in ENTRIES
        },
    }
    before, after = (next(iter(one.parameters.values()), {}) for one in (first, second))
    moved = {
        name: f"{number(before[name])} -> {number(value)}"
        for name, value in after.items()
        if name in before and abs(value - before[name]) > CHANGED * abs(before[name])
    }
    return {
        "first_then_second": {
            name: list(pair) for name, pair in pairs.items() if pair[0] != pair[1]
        },
        "moved": dict(list(moved.items())[:MOVED]),
        **left_out("moved", MOVED, len(moved)),
    }


def sentences(found: Sequence[Violation]) -> list[PlainData]:
    """Violations or warnings with their lines."""
    return [{"line": one.line, "message": one.message} for one in found]
