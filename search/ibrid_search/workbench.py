"""The tools with the one that evaluates: a program is checked, fitted and kept in a logbook."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ibrid.fit.settings import FitSettings
from ibrid.study import Study
from ibrid_search.logbook import Logbook
from ibrid_search.record_view import record_view
from ibrid_search.step import Status
from ibrid_search.tool import Tool
from ibrid_search.tools import PROGRAM, Tools


class Workbench(Tools):
    """The tools with evaluate_program: programs are evaluated and kept in a logbook."""

    def __init__(self, logbook: Logbook) -> None:
        super().__init__(logbook.study, logbook)
        self.logbook = logbook

    @property
    def all(self) -> tuple[Tool, ...]:
        """evaluate_program and the reading tools."""
        most = self.logbook.fit.seconds
        settings = {
            "type": "object",
            "description": "effort; the default is right unless a fit looks stuck or a prediction is wanted",
            "properties": {
                "restarts": {
                    "type": "integer",
                    "minimum": 0,
                    "maximum": 20,
                    "description": "further waves of starts at most",
                },
                "seed": {"type": "integer", "minimum": 0, "maximum": 2**32 - 1, "description": "of the starts"},
                "seconds": {"type": "number", "minimum": 0.1, "maximum": most, "description": f"time limit ({most:g})"},
                "holdout_op": {
                    "type": "array",
                    "items": {"type": "string", "maxLength": 200},
                    "description": "operating points to keep out of the fit and predict",
                },
            },
        }
        return (
            Tool(
                "evaluate_program",
                "Check a program and fit its parameters to the measured admittance; answers with NRMSE (lower is better), "
                "where the error lies, and what is wrong when it is refused. A structure met before costs nothing.",
                {
                    "program": PROGRAM,
                    "note": {"type": "string", "maxLength": 500, "description": "what changes and why, in a line"},
                    "parent": {"type": "integer", "minimum": 0, "description": "step that the program was made from"},
                    "settings": settings,
                },
                self.evaluate_program,
                ("program",),
            ),
            *self.reading,
        )

    def evaluate_program(
        self, program: str, note: str = "", parent: int | None = None, settings: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """How the step ended, and its record."""
        best = self.logbook.best(1)
        study, fit = self._asked(settings or {})
        step = self.logbook.submit(program, note=note, parent=parent, study=study, fit=fit)
        answer: dict[str, Any] = {"step": step.number, "status": step.status}
        if best:
            answer["best_before"] = {"step": best[0].step, "nrmse": best[0].record.nrmse}
        if step.status in (Status.UNREADABLE, Status.ILLEGAL):
            return answer | {"violations": self.check_grammar(program).get("violations", [step.reason])}
        if step.status not in (Status.OK, Status.DUPLICATE):
            return answer | {"reason": step.reason}
        same = {} if step.same_as is None else {"same_as": step.same_as, "reason": step.reason}
        return answer | same | record_view(self.steps.record(step.number), self.study.sweep)

    def _asked(self, settings: Mapping[str, Any]) -> tuple[Study, FitSettings]:
        """The study and the effort with what a call changes; IbridError for what makes no sense."""
        of_fit = {name: value for name, value in settings.items() if name in ("restarts", "seconds")}
        of_study = {name: value for name, value in settings.items() if name not in of_fit}
        return replace(self.study, **of_study), replace(self.logbook.fit, **of_fit)
