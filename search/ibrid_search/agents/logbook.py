"""Programs that an agent had evaluated, numbered, each structure once; kept in memory, and in a
store when there is one.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError, ProgramError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.interrupts import heed_interrupt
from ibrid.structure.compiling.compiled import compile_diagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study
from ibrid.writing import inside, write_json
from ibrid_search.blocks import shown
from ibrid_search.evaluation.verdict import STATUS
from ibrid_search.proposal import Evaluated
from ibrid_search.run.run_folder import SELECTION, write_best
from ibrid_search.run.store import Store, numbers_of
from ibrid_search.screening.selection_criterion import build_criterion
from ibrid_search.selection.selecting import given_answer
from ibrid_search.settings import SearchSettings
from ibrid_search.step import Status, Step

#: Characters that are kept of a refused program, and of the reasons.
KEPT = 20_000
#: Of an evaluation that asks for nothing else.
USUAL = FitSettings()


class Logbook:
    """Evaluates programs under one study and remembers them.

    `fit` : effort of an evaluation that asks for nothing else. `store`, `folder` : where steps and
    the best program go too.
    `steps` : of an earlier sitting, whose records are in the store.
    """

    def __init__(
        self,
        study: Study,
        *,
        fit: FitSettings = USUAL,
        store: Store | None = None,
        folder: Path | None = None,
        steps: Sequence[Step] = (),
    ) -> None:
        self.study = study
        self.fit = fit
        self._store, self._folder = store, folder
        self._steps = list(steps)
        self._records: dict[int, Record] = {}
        self._known = {_key(one.hash, one.usage): one.number for one in self._steps if _final(one)}

    @property
    def steps(self) -> tuple[Step, ...]:
        """All of them, refused ones too."""
        return tuple(self._steps)

    def known(self, diagram: Diagram) -> int | None:
        """Step of the same structure under the usual effort; None when it was not evaluated.

        The diagram is legal.
        """
        return self._known.get(_key(self.study.hash_of(diagram), {}))

    def met(self, diagram: Diagram) -> str | None:
        """The same in words."""
        number = self.known(diagram)
        return None if number is None else f"step {number}"

    def submit(
        self,
        program: str,
        *,
        note: str = "",
        parent: int | None = None,
        study: Study | None = None,
        fit: FitSettings | None = None,
    ) -> Step:
        """Check and evaluate a program; the step says how it ended, whatever the text is.

        `note` : what changes, in a line. `parent` : fitted step that it was made from, for the
        lineage; its values are tried beside the starts. `study`, `fit` : with another seed or other
        held-out points, and another effort than usual. Raises IbridError for a parent that has no
        fit.
        """
        study, fit = study or self.study, fit or self.fit
        if parent is not None:
            self.record(parent)
        step = Step(
            len(self._steps),
            parent,
            proposer="tools",
            note=shown(note),
            usage=self._unusual(study, fit),
        )
        try:
            diagram = parse_program(program)
        except ProgramError as error:
            return self._keep(
                replace(step, status=Status.UNREADABLE, reason=str(error), program=program[:KEPT])
            )
        step = replace(step, program=program_text(diagram))
        compiled = compile_diagram(diagram, self.study.kinds, equilibrium=self.study.equilibrium)
        if compiled.violations:
            reason = "; ".join(map(str, compiled.violations))[:KEPT]
            return self._keep(
                replace(step, status=Status.ILLEGAL, reason=reason, program=step.program[:KEPT])
            )
        step = replace(step, hash=compiled.structure_hash)
        if (same := self._known.get(_key(step.hash, step.usage))) is not None:
            reason = f"the same structure as step {same}, whose evaluation stands"
            first = self._steps[same]
            return self._keep(
                replace(
                    step, status=Status.DUPLICATE, reason=reason, same_as=same, nrmse=first.nrmse
                )
            )
        return self._evaluate(step, diagram, study, fit)

    def record(self, number: int) -> Record:
        """The record of a fitted step, or of the one that it repeats; IbridError when there is
        none.
        """
        if not 0 <= number < len(self._steps):
            last = len(self._steps) - 1
            found = (
                f"steps run from 0 to {last}" if self._steps else "nothing has been evaluated yet"
            )
            raise IbridError(f"there is no step {number}; {found}")
        step = self._steps[number]
        if step.same_as is not None:
            return self.record(step.same_as)
        if number not in self._records:
            if step.status is not Status.OK or self._store is None:
                raise IbridError(
                    f"step {number} has no fit ({step.status}: {step.reason[:200]}); list_best "
                    "names those that have"
                )
            return self._store.record(number, self.study.kinds)
        return self._records[number]

    def best(self, count: int) -> tuple[Evaluated, ...]:
        """The most plausible fitted steps of the usual effort, error against free numbers as a
        search weighs them, stable ones first; an unstable model is no answer.
        """
        worth = build_criterion(self.study, SearchSettings())

        def rank(step: Step) -> tuple[bool, float, int, int]:
            error = worth.floor.error_of(self.record(step.number))
            return (
                not step.stable,
                worth.score(error, int(step.free or 0)),
                int(step.order or 0),
                step.number,
            )

        fitted = [
            step
            for step in self._steps
            if step.status is Status.OK and "holdout_op" not in step.usage
        ]
        return tuple(self._evaluated(step.number) for step in sorted(fitted, key=rank)[:count])

    def answer(self, number: int, reasons: str) -> None:
        """Keep a fitted step as the answer, with its reasons: in the store, in best.py and
        best.json, and as selection.json.
        """
        record = self.record(number)
        if self._store is not None:
            self._store.set_meta("best", str(number))
            self._store.set_meta("ending", "an agent has given its answer")
        if self._folder is not None:
            write_best(self._folder, record)
            write_json(
                inside(self._folder, SELECTION), given_answer(number, reasons, self._steps, record)
            )

    def note_call(self, name: str, arguments: Any, answer: Mapping[str, Any]) -> None:
        """Keep a call of a tool and what it was answered, for whoever reads the run later."""
        if self._store is not None:
            self._store.note_call(name, arguments, answer)

    def _evaluated(self, number: int) -> Evaluated:
        record = self.record(number)
        return Evaluated(number, record.diagram, record)

    def _unusual(self, study: Study, fit: FitSettings) -> dict[str, Any]:
        """What is asked for beyond the usual."""
        usual, asked = (
            {
                "restarts": fit.restarts,
                "seed": study.seed,
                "effort": fit.effort,
                "holdout_op": list(study.held),
            }
            for study, fit in ((self.study, self.fit), (study, fit))
        )
        return {name: value for name, value in asked.items() if value != usual[name]}

    def _evaluate(self, step: Step, diagram: Diagram, study: Study, fit: FitSettings) -> Step:
        warm = None if step.parent is None else self.record(step.parent).parameters
        if self._store is not None:
            self._store.propose(step)
        try:
            record = evaluate(diagram, study, settings=fit, warm=warm)
        except (
            Exception
        ) as error:  # unforeseen, so it goes on; but the number of the step is used up
            heed_interrupt()
            reason = f"{type(error).__name__}: {error}"
            self._conclude(replace(step, status=Status.LOST, reason=reason), None)
            raise
        if record.outcome != Outcome.OK:
            status, reason = STATUS[Outcome(record.outcome)], "; ".join(record.reasons)
            return self._conclude(
                replace(step, status=status, reason=reason, seconds=record.seconds), None
            )
        fitted = replace(step, status=Status.OK, **numbers_of(vars(record)))
        self._conclude(fitted, record)
        best = self.best(1)
        answered = (
            self._store is not None and "best" in self._store.meta
        )  # the files are those of the answer
        if self._folder is not None and not answered and best and best[0].step == step.number:
            write_best(self._folder, record)
        return fitted

    def _conclude(self, step: Step, record: Record | None) -> Step:
        self._steps.append(step)
        if record is not None:
            self._records[step.number] = record
        if _final(step):
            self._known[_key(step.hash, step.usage)] = step.number
        if self._store is not None:
            self._store.conclude(
                step.number,
                status=step.status,
                reason=step.reason,
                record=record,
                seconds=step.seconds,
            )
        return step

    def _keep(self, step: Step) -> Step:
        self._steps.append(step)
        if self._store is not None:
            self._store.propose(step)
        return step


def _final(step: Step) -> bool:
    """True when the same question would get the same answer again."""
    return step.status in (Status.OK, Status.FAILED)


def _key(structure: str, unusual: Mapping[str, Any]) -> tuple[str, str]:
    return structure, json.dumps(dict(unusual), sort_keys=True)
