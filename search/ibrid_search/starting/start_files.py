"""The files of a first result (start.json, model, report), and commands to go on with."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ibrid.measurement.quality.event_inspection import EventsInspection
from ibrid.measurement.quality.inspection_table import format_events_inspection, format_inspection
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.own_files import writing_as
from ibrid.report.facts.bases import admittance_base
from ibrid.report.figures.bode import Curves, bode_svgs, impedance_svgs
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.playback_page import facts_of_record
from ibrid.report.pages.template import page
from ibrid.writing import inside, write_json, write_whole
from ibrid_search.starting.start_result import GOOD_GRADES, StartResult

PROGRAM = "model.py"
RECORD = "model.json"
JSON = "start.json"
PAGE = "report.html"
FILES = (PROGRAM, RECORD, JSON, PAGE)

Command = list[str]


@writing_as("start")
def write_start(
    result: StartResult, data: str, folder: Path, data_options: Sequence[str] = ()
) -> StartResult:
    """Write start.json, model.py, model.json and report.html to a folder.

    Parameters
    ----------
    data : str
        The sweep or the recordings as the suggested commands name them.
    data_options : Sequence[str]
        Options of the suggested commands that describe the data: terminal network, recordings in
        addition to a sweep, channels.

    Returns
    -------
    StartResult
        With the suggested commands.
    """
    record = result.best.record
    if record is not None:
        write_whole(inside(folder, PROGRAM), record.program)
        record.write(inside(folder, RECORD))
    result = replace(result, next=suggest_commands(result, data, folder, data_options))
    write_json(inside(folder, JSON), result.to_json())
    write_whole(inside(folder, PAGE), start_html(result))
    return result


def start_html(result: StartResult) -> str:
    """Return the report as HTML."""
    record = result.best.record
    sweep = result.data if isinstance(result.data, Sweep) else None
    facts = _measured_alone(sweep) if record is None else record_facts(record, sweep, "bode")
    facts["events"] = facts_of_record(record, result.recordings)
    if isinstance(result.inspection, EventsInspection):
        inspection_text = format_events_inspection(result.inspection)
    else:
        inspection_text = format_inspection(result.inspection)
    context = {
        **facts,
        "result": result,
        "has_sweep": result.has_sweep,
        "inspection_text": inspection_text,
    }
    return page("start.html", context, "ibrid_search")


def _measured_alone(sweep: Sweep | None) -> dict[str, Any]:
    """Figures of the data where no diagram could be fitted."""
    if sweep is None:
        return {}
    dots = [
        Curves(point.op.name, index, point, None, None) for index, point in enumerate(sweep.points)
    ]
    label = f", magnitude and phase over frequency, at {', '.join(sweep.names)}."
    return {
        "doubts": [],
        "points": list(sweep.names),
        "bode": bode_svgs(dots, "bode", label),
        "impedance": impedance_svgs(dots, "bode-z", label),
        "y_base": admittance_base(sweep),
    }


def suggest_commands(
    result: StartResult, data: str, folder: Path, data_options: Sequence[str]
) -> tuple[str, ...]:
    """Suggest three commands to go on with, the most useful for the grade first.

    Where no diagram of one device fits a sweep, a fourth command tries two devices.
    """
    model = str(folder / PROGRAM)
    record = str(folder / RECORD)
    two_devices = result.family.startswith("two devices")
    device_options = ["--devices", "2"] if two_devices else []

    search: Command = ["ibrid", "search", data, *data_options, *device_options]
    search += ["--out", str(folder / "search")]
    gap: Command = ["ibrid", "gap", model if result.has_sweep else record, data, *data_options]
    gap += ["--out", str(folder / "gap")]
    stability: Command = ["ibrid", "stability", record, "--scr", "1.5:10"]
    stability += ["--report", str(folder / "stability.html")]
    export: Command = ["ibrid", "export", record, "--op", result.data.names[0]]
    export += ["--format", "control-json", "--out", str(folder / "linear.json")]

    is_good = result.best.grade in GOOD_GRADES
    if result.best.record is None:
        commands = [search, ["ibrid", "inspect", data], ["ibrid", "modules"]]
    elif is_good and not result.single_event:
        commands = [stability, export, search if two_devices else gap]
    elif result.has_sweep:
        commands = [search, gap, stability]
    else:  # in recordings a limiter is more likely than another control structure
        commands = [gap, search, stability]
    if not is_good and result.devices == 1 and result.has_sweep:
        start: Command = ["ibrid", "start", data, *data_options, "--devices", "2"]
        start += ["--out", f"{folder}_of_two"]
        commands.append(start)
    return tuple(map(shlex.join, commands))
