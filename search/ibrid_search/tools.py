"""The tools of an agent that change nothing: vocabulary, grammar, records, comparison. Text is read, never run."""

from collections.abc import Sequence
from typing import Any

from ibrid.errors import IbridError, ProgramError
from ibrid.evaluation.time_limit import time_limit
from ibrid.modules.in_full import kind_in_full
from ibrid.modules.vocabulary import find_kind
from ibrid.structure.check import Violation, examine
from ibrid.structure.compare import compare
from ibrid.structure.diagram import Diagram
from ibrid.structure.parameters import parameter_table
from ibrid.structure.program import LONGEST_PROGRAM, parse_program
from ibrid.structure.wiring import wire
from ibrid.study import Study
from ibrid_search.insight import Insight
from ibrid_search.language import api_text, kinds_text, rules_text
from ibrid_search.record_view import RecordPart, record_view, summary
from ibrid_search.tool import STEP, Steps, Tool

#: Seconds that looking, checking and comparing may take.
LOOKING = 10.0
#: Candidates that list_best gives at most, and without being asked for a number.
MOST_LISTED, LISTED = 20, 5

PROGRAM = {
    "type": "string",
    "maxLength": LONGEST_PROGRAM,
    "description": "program text: one def with g.add and g.connect",
}
_EITHER = {
    "type": ["string", "integer"],
    "maxLength": LONGEST_PROGRAM,
    "minimum": 0,
    "description": "program text, or the number of an evaluated step",
}


class Tools:
    """The tools over what was evaluated so far under one study; `ibrid_search.workbench` adds the one that evaluates."""

    def __init__(self, study: Study, steps: Steps) -> None:
        self.study, self.steps = study, steps

    @property
    def reading(self) -> tuple[Tool, ...]:
        """Tools that evaluate nothing."""
        return (
            *Insight(self.study, self.steps).tools,
            Tool(
                "show_record",
                "Where the error of an evaluated step lies, worst parts first (operating point, frequency band, admittance "
                "entry), with parameters, those at a bound, stability and what the data cannot tell. "
                "With op, band or entry: all frequencies of that part.",
                {
                    "step": STEP,
                    "op": {"type": "string", "maxLength": 200, "description": "operating point, such as p=1,q=0.3"},
                    "band": {
                        "type": "string",
                        "maxLength": 40,
                        "description": "5-50, 50-500, 500-2000 or 2000-5000 (Hz)",
                    },
                    "entry": {"type": "string", "maxLength": 10, "description": "dd, dq, qd or qq"},
                },
                self.show_record,
                ("step",),
            ),
            Tool(
                "list_best",
                "The best evaluated programs so far with NRMSE, order, free parameters and stability; stable ones first.",
                {
                    "count": {
                        "type": "integer",
                        "minimum": 1,
                        "maximum": MOST_LISTED,
                        "description": f"how many ({LISTED})",
                    }
                },
                self.list_best,
            ),
            Tool(
                "check_grammar",
                "Whether a program is legal, with every violation and what would mend it, at no cost.",
                {"program": PROGRAM},
                self.check_grammar,
                ("program",),
            ),
            Tool(
                "describe_vocabulary",
                "The kinds of modules with ports and parameters and how programs are written; one kind in full when named.",
                {"kind": {"type": "string", "maxLength": 100, "description": "name of a kind"}},
                self.describe_vocabulary,
            ),
            Tool(
                "compare_programs",
                "Two diagrams matched up to naming: what they have in common and what only one has.",
                {"a": _EITHER, "b": _EITHER},
                self.compare_programs,
                ("a", "b"),
            ),
        )

    def show_record(
        self, step: int, op: str | None = None, band: str | None = None, entry: str | None = None
    ) -> dict[str, Any]:
        """`ibrid_search.record_view` of a step, with its program."""
        record = self.steps.record(step)
        return {
            "step": step,
            **record_view(record, self.study.sweep, RecordPart(op, band, entry)),
            "program": record.program,
        }

    def list_best(self, count: int = LISTED) -> dict[str, Any]:
        """The best steps with their programs."""
        best = self.steps.best(count)
        return {"best": [{"step": one.step, **summary(one.record), "program": one.record.program} for one in best]}

    def check_grammar(self, program: str) -> dict[str, Any]:
        """Violations and warnings, and the size of what is legal."""
        try:
            diagram = parse_program(program)
        except ProgramError as error:
            return {"legal": False, "violations": [{"line": None, "message": str(error)}]}
        with time_limit(LOOKING):
            found, habits = examine(diagram, self.study.kinds, equilibrium=self.study.equilibrium)
            if found:
                return {"legal": False, "violations": sentences(found)}
            wiring = wire(diagram, self.study.kinds)
            met = self.steps.met(diagram)
        return {
            "legal": True,
            "warnings": sentences(habits),
            "modules": len(diagram.instances),
            "order": sum(kind.order for kind in wiring.kinds.values()),
            "free_parameters": len(parameter_table(wiring, self.study.equilibrium).free),
            "met_before": met,
        }

    def describe_vocabulary(self, kind: str | None = None) -> dict[str, Any]:
        """All kinds in a line each, or one in full."""
        kinds, equilibrium = self.study.kinds, self.study.equilibrium
        if kind is not None:
            return {"kind": kind, "lines": kind_in_full(find_kind(kind, kinds)).splitlines()}
        return {
            "language": api_text().splitlines(),
            "rules": rules_text(kinds, equilibrium).splitlines(),
            "kinds": kinds_text(kinds, equilibrium, short=True).splitlines(),
        }

    def compare_programs(self, a: str | int, b: str | int) -> dict[str, Any]:
        """`ibrid compare` of two legal programs."""
        with time_limit(LOOKING):
            return compare(self._legal(a, "a"), self._legal(b, "b"), self.study.kinds).to_json()

    def _legal(self, program: str | int, name: str) -> Diagram:
        if isinstance(program, int):
            return self.steps.record(program).diagram
        diagram = parse_program(program, name)
        if found := examine(diagram, self.study.kinds, equilibrium=self.study.equilibrium)[0]:
            raise IbridError(f"{name} is not legal: {found[0]}; check_grammar tells all of it")
        return diagram


def sentences(found: Sequence[Violation]) -> list[dict[str, Any]]:
    """Violations or warnings with their lines."""
    return [{"line": one.line, "message": one.message} for one in found]
