"""One answer against the truth: verdict, name, class, held-out error and intervals; below the
detection limit as above.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from ibrid_bench.gap.detection import Visibility
from ibrid_bench.gap.diagnosis import Diagnosis
from ibrid_bench.gap.held_out import held_out_ratio
from ibrid_bench.gap.intervals import covered
from ibrid_bench.gap.naming import naming
from ibrid_bench.hidden.case import Case

Row = dict[str, Any]

#: Verdicts that name something, and those that raise an alarm where nothing is missing.
NAMING = ("named", "data-convention")
ALARMS = ("named", "located-unnamed", "data-convention")
FAILED = "failed"


def score(case: Case, diagnosis: Diagnosis, seen: Sequence[Visibility]) -> Row:
    """Numbers of an answer; None where a question does not arise.

    `verdict` : answered, "failed" without an answer. `right_verdict` : among those that the truth
    accepts. `above` : every hidden effect is above the detection limit. `answer`, `classes` :
    "id:change" of the effects, and the ids that each cannot be told from. `named_first`,
    `inside_class`, `class_size`, `all_named` : see `naming`. `false_alarm` : nothing is missing,
    and the answer says otherwise. `false_name` : something foreign is hidden, and it gets a name.
    `holdout` : error at the held-out point over the noise floor, of a named repair. `covered` : see
    `covered`.
    """
    truth, gap = case.truth, diagnosis.gap
    verdict = gap.get("verdict", FAILED)
    effects = gap.get("effects", [])
    named = verdict == "named"
    row: Row = {
        "base": truth["base"],
        "hidden": [f"{one['id']}:{one['change']}:{one['variant']}" for one in truth["effects"]],
        "verdicts": truth["verdicts"],
        "gains": [_finite(one.gain) for one in seen],
        "pulls": [_finite(one.pull) for one in seen],
        "above": all(one.above for one in seen) if seen else None,
        "verdict": verdict,
        "failure": diagnosis.failure,
        "right_verdict": verdict in truth["verdicts"],
        "answer": [f"{one['id']}:{one['change']}" for one in effects],
        "classes": [list(one.get("indistinguishable_from", ())) for one in effects],
        **naming(truth, gap),
        "false_alarm": verdict in ALARMS if truth["kind"] in ("nothing", "parameters") else None,
        "false_name": named if truth["kind"] == "foreign" else None,
        "holdout": held_out_ratio(diagnosis.record, case) if named and diagnosis.record else None,
        "covered": covered(gap, truth) if verdict in NAMING else [0, 0, 0],
        "seconds": round(diagnosis.seconds, 2),
    }
    return row


def _finite(number: float) -> float | None:
    return round(number, 3) if np.isfinite(number) else None
