"""`ibrid export RECORD` and `ibrid report RECORD|DIR`: what is made from a record."""

from argparse import Namespace
from pathlib import Path

from ibrid.commands import inputs
from ibrid.errors import IbridError
from ibrid.own_files import DATABASE, adopt, also_reading
from ibrid.plugins import command
from ibrid.streams import complain
from ibrid.writing import inside, require_place

#: The record in a folder that holds results, in the order in which they are looked for.
RECORD_NAMES = ("best.json", "model.json", "record.json")


def run_export(arguments: Namespace) -> int:
    """Write the linear model."""
    from ibrid.analysis.models.validity import doubts
    from ibrid.export.formats import ALWAYS_NONLINEAR, export
    from ibrid.plants.sweeping import frequency_grid

    frequency = None if arguments.freq is None else frequency_grid(arguments.freq)
    record = inputs.record(arguments.record, arguments.kinds)
    model = export(
        record,
        arguments.out,
        arguments.format,
        arguments.op,
        name=arguments.name,
        frequency=frequency,
        nonlinear=arguments.nonlinear,
        windows=arguments.windows,
    )
    nonlinear = arguments.nonlinear or arguments.format in ALWAYS_NONLINEAR
    where = "; ".join(record.parameters) if arguments.op == "all" else model.op
    print(
        f"{arguments.out}: {len(model.states)} states at "
        f"{where}{', nonlinear' if nonlinear else ''}"
    )
    if nonlinear and record.diagram.outside.elements:
        complain(
            "the nonlinear model is the device behind its port; put the port's elements into the "
            "network round it"
        )
    for doubt in doubts(record, model, frequency):
        complain(doubt)
    return 0


def run_report(arguments: Namespace) -> int:
    """Write the page and say where it is; whether its data are those of the record is a remark."""
    if (Path(arguments.record) / DATABASE).is_file():
        inputs.require_no_events_options(arguments)
        if arguments.events is not None:
            raise IbridError(
                "the page of a search shows no records of events; leave --events out or report "
                "best.json"
            )
        return command("search:reporting.report_run")(arguments)
    source = _record_file(Path(arguments.record))
    inside = Path(arguments.record).is_dir()
    beside = source.with_name("report.html" if inside else f"{source.stem}.html")
    out = beside if arguments.out is None else arguments.out
    also_reading({"RECORD": source})
    if inside:
        adopt(source.parent, ["report.html"])
    require_place(out)
    record = inputs.record(source, arguments.kinds)
    require_place(out)
    sweep = inputs.data(arguments.data) if arguments.data is not None else None
    events = None
    if arguments.events is not None:
        events = inputs.events(arguments.events, inputs.said_of_events(arguments))
    else:
        inputs.require_no_events_options(arguments)

    from ibrid.report.pages.page import measured_data, measured_events, write_report

    sweep, remark = measured_data(record, sweep)
    events, other = measured_events(record, events)
    write_report(record, out, sweep=sweep, events=events)
    print(out)
    if remark:
        complain(f"{source}: {remark} (--data DATA names it)")
    if other:
        complain(f"{source}: {other} (--events EVENTS names them)")
    return 0


def _record_file(path: Path) -> Path:
    if not path.is_dir():
        return path
    for name in RECORD_NAMES:
        if inside(path, name).is_file():
            return path / name
    raise IbridError(f"{path}: must hold a record; found none of {', '.join(RECORD_NAMES)}")
