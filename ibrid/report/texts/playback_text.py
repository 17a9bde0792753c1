"""What `ibrid playback` prints: errors by record and window."""

from collections.abc import Mapping
from typing import Any

from ibrid.foreign_text import controls_shown
from ibrid.measurement.recordings.event_windows import WINDOWS
from ibrid.playback.compare import Playback
from ibrid.report.facts.step_rows import STEP_HEAD, step_rows
from ibrid.report.look.numbers import number
from ibrid.report.texts.text import table, validation_lines


@controls_shown
def playback_text(
    playback: Playback,
    validation: Mapping[str, Any] | None = None,
    steps: Mapping[str, Any] | None = None,
) -> str:
    """A table; what acts at rest already, and why a record has no error; how set points are
    followed; the measures of a standard.
    """
    rows = [
        [
            one.record.name,
            "left" if one.left is not None else "-" if one.nrmse is None else number(one.nrmse, 3),
            *(number(one.by_window[name], 3) if name in one.by_window else "-" for name in WINDOWS),
        ]
        for one in playback.records
    ]
    lines = table(["record", "NRMSE", *WINDOWS], rows)
    lines += [said for one in playback.records for said in (*one.acting, one.remark) if said]
    lines += table(STEP_HEAD, step_rows(steps)) if steps else []
    return "\n".join([*lines, *validation_lines(validation)])
