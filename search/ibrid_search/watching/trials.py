"""The trials of a run as a table: what each changed, what was fitted, and how well."""

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.modules.kind import ModuleKind
from ibrid.report.facts.parameter_rows import parameter_rows
from ibrid.structure.comparison.compare import difference
from ibrid.writing import PlainData, inside
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.step import EVALUATED, Step

#: Trials of a table, those of the lowest error first.
LISTED = 400
#: Characters of a reason and of a note.
LONGEST = 200


class Trials:
    """The evaluated proposals of a run; what was read once is kept, as it does not change.

    folder : of the run. kinds : its vocabulary.
    """

    def __init__(self, folder: Path, kinds: Sequence[ModuleKind]) -> None:
        self._folder, self._kinds = folder, tuple(kinds)
        self._read: dict[int, tuple[dict[str, Any], dict[str, str]]] = {}
        self._reading = threading.Lock()

    def table(self) -> PlainData:
        """`rows`, a mapping for each trial, `units`, parameter -> its unit, and `left_out`, how
        many trials of larger error there are.

        `difference` : lines that the trial took out of its parent ("-") or put in ("+").
        `parameters` : name -> its lowest and highest value over the operating points.

        Raises IbridError where there is no run.
        """
        with self._reading, Store.open(inside(self._folder, ARCHIVE), read_only=True) as store:
            steps = {step.number: step for step in store.steps()}
            tried = [step for step in steps.values() if step.status in EVALUATED]
            tried.sort(key=lambda step: (step.nrmse is None, step.nrmse or 0.0, step.number))
            units: dict[str, str] = {}
            rows = []
            for step in tried[:LISTED]:
                if step.number not in self._read:
                    parent = None if step.edited is None else steps.get(step.edited)
                    self._read[step.number] = self._trial(store, step, parent)
                row, known = self._read[step.number]
                rows.append(row)
                units |= known
        return {"rows": rows, "units": units, "left_out": len(tried) - len(rows)}

    def _trial(
        self, store: Store, step: Step, parent: Step | None
    ) -> tuple[dict[str, Any], dict[str, str]]:
        """A row, and the units of its parameters."""
        changes = () if parent is None else difference(parent.program, step.program, around=0)
        values, units = self._parameters(store, step)
        row = {
            "step": step.number,
            "parent": step.edited,
            "status": str(step.status),
            "reason": step.reason[:LONGEST],
            "nrmse": step.nrmse,
            "stable": step.stable,
            "order": step.order,
            "free": step.free,
            "seconds": step.seconds,
            "proposer": step.proposer,
            "note": step.note[:LONGEST],
            "difference": [f"{line[0]} {line[1:].strip()}" for line in changes if line != "..."],
            "parameters": values,
        }
        return row, units

    def _parameters(
        self, store: Store, step: Step
    ) -> tuple[dict[str, tuple[float, float]], dict[str, str]]:
        """Lowest and highest value of each parameter, and its unit; nothing of a trial without a
        fit.
        """
        if step.nrmse is None:
            return {}, {}
        try:
            fitted = parameter_rows(store.record(step.number, self._kinds))
        except IbridError:
            return {}, {}
        values: dict[str, tuple[float, float]] = {}
        for row in fitted:
            low, high = values.get(row.name, (row.value, row.value))
            values[row.name] = (min(low, row.value), max(high, row.value))
        return values, {row.name: row.unit for row in fitted}
