"""The tools with those that change a logbook: a program is checked, fitted and kept, and an answer
is given with its reasons.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.grade import Grade
from ibrid.fit.settings import EFFORTS, FitSettings, fit_settings
from ibrid.report.facts.verdict import graded, verdict
from ibrid.structure.diagrams.program import LONGEST_PROGRAM, program_text
from ibrid.study import Study
from ibrid.writing import PlainData
from ibrid_search.agents.logbook import Logbook
from ibrid_search.agents.tool import Tool, tools_in
from ibrid_search.agents.tools import Tools
from ibrid_search.language_models.record_view import record_view
from ibrid_search.step import Status

#: Characters of the reasons for an answer.
LONGEST_REASONS = 4_000


class Workbench(Tools):
    """The tools with evaluate_program, evaluate_edit and finish, over a logbook."""

    def __init__(self, logbook: Logbook, answer_within: float | None = None) -> None:
        super().__init__(logbook.study, logbook, "evaluate_program", answer_within)
        self.logbook = logbook

    @property
    def all(self) -> tuple[Tool, ...]:
        """evaluate_program, evaluate_edit, finish and the reading tools."""
        own = tools_in(
            "workbench.toml",
            self,
            longest_program=LONGEST_PROGRAM,
            longest_reasons=LONGEST_REASONS,
            efforts=list(EFFORTS),
            diagrams=self.insight.diagrams,
        )
        return (*own, *self.reading)

    def evaluate_program(
        self,
        program: str | None = None,
        note: str = "",
        parent: int | None = None,
        settings: Mapping[str, Any] | None = None,
        name: str | None = None,
    ) -> PlainData:
        """How the step of a program, or of the shipped diagram of that name, ended, and its
        record.
        """
        if (program is None) == (name is None):
            raise IbridError(
                "evaluate_program takes a program or the name of a shipped diagram; give one"
            )
        if program is None:
            program = str(self.insight.read_diagram(name=name)["program"])
        best = self.logbook.best(1)
        study, fit = self._asked(settings or {})
        step = self.logbook.submit(program, note=note, parent=parent, study=study, fit=fit)
        answer: PlainData = {"step": step.number, "status": step.status}
        if best:
            answer["best_before"] = {"step": best[0].step, "nrmse": best[0].record.nrmse}
        if step.status in (Status.UNREADABLE, Status.ILLEGAL):
            return answer | {
                "violations": self.check_grammar(program).get("violations", [step.reason])
            }
        if step.status not in (Status.OK, Status.DUPLICATE):
            return answer | {"reason": step.reason}
        same = {} if step.same_as is None else {"same_as": step.same_as, "reason": step.reason}
        record = self.steps.record(step.number)
        then = (
            f"finish with step={step.number}, or show_residuals"
            if graded(record) is Grade.EXPLAINS
            else f"diagnose with step={step.number}"
        )
        return answer | same | {"next": then} | record_view(record, self.study.sweep)

    def evaluate_edit(self, step: int, place: int = 1, note: str = "") -> PlainData:
        """As `evaluate_program` of the edit at a place of the last diagnosis of a step; without a
        word of the program.
        """
        edit = self.insight.edit_at(step, place)
        return {"edit": edit.description} | self.evaluate_program(
            program_text(edit.diagram), note or edit.description, parent=step
        )

    def finish(self, step: int, reasons: str) -> PlainData:
        """The answer is kept; what speaks against it is said."""
        record = self.steps.record(step)
        if not reasons.strip():
            raise IbridError("an answer has reasons; say what the data show and what was ruled out")
        doubts = [f"unstable at {op}" for op, stable in record.stable.items() if not stable]
        if graded(record) is not Grade.EXPLAINS:
            doubts.append(f"it leaves more than noise: {verdict(record)}")
        if record.at_bound:
            doubts.append(
                f"{', '.join(record.at_bound)} at the end of what is allowed: the part does "
                "nothing there, or another kind belongs in its place"
            )
        best = self.logbook.best(1)
        explained_by_less = (
            graded(record) is Grade.EXPLAINS
            and bool(best)
            and record.free_parameters < best[0].record.free_parameters
        )
        if best and best[0].step != step and not explained_by_less:
            doubts.append(
                f"step {best[0].step} is more plausible (NRMSE {best[0].record.nrmse:.3g})"
            )
        self.logbook.answer(step, reasons)
        return {
            "answer": step,
            "kept": True,
            "doubts": doubts,
            "next": "nothing, or go on and finish again",
        }

    def _asked(self, settings: Mapping[str, Any]) -> tuple[Study, FitSettings]:
        """The study and the effort with what a call changes; IbridError for what makes no sense."""
        asked = dict(settings)
        effort = asked.pop("effort", None)
        fit = self.logbook.fit if effort is None else fit_settings(effort)
        if "restarts" in asked:
            fit = replace(fit, restarts=asked.pop("restarts"))
        return replace(self.study, **asked), fit
