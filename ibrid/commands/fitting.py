"""`ibrid evaluate PROGRAM DATA`: fit a diagram to a sweep and show the record."""

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from ibrid.commands import inputs
from ibrid.commands.outputs import add_json_option, complain, give_json, require_distinct, require_json_place
from ibrid.commands.own_kinds import add_kinds_option
from ibrid.writing import require_place

if TYPE_CHECKING:
    from ibrid.evaluation.record import Record


def declare(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser("evaluate", help="fit a diagram to a sweep: parameters, errors, identifiability")
    parser.add_argument("program", metavar="PROGRAM", help=inputs.PROGRAM_HELP)
    parser.add_argument("data", metavar="DATA", help=inputs.DATA_HELP)
    parser.add_argument("--parameters", default="shared", help="shared (default) | per-op")
    parser.add_argument("--equilibrium", default="exact", help="exact (default) | paper")
    parser.add_argument("--vocabulary", default="extended", help="extended (default) | paper")
    add_kinds_option(parser)
    parser.add_argument(
        "--objective",
        help="sigma: error over the measured noise (default where that is known) | nrmse: error over the size of the whole "
        "sweep, the paper's (default where it is not) | relative: error at each frequency over its own size | band: each "
        "frequency band counts alike",
    )
    parser.add_argument("--restarts", type=inputs.natural, metavar="N", help="further waves of starts at most (5)")
    parser.add_argument("--seed", type=inputs.natural, default=0, metavar="N", help="of the random starts (0)")
    parser.add_argument(
        "--holdout-op", action="append", default=[], metavar="OP", help="keep this point out and predict it, repeatable"
    )
    inputs.add_port_option(parser)
    inputs.add_labels_option(parser, "exact")
    parser.add_argument("--seeds", default="textbook", help="starts from: textbook (default) | vector-fitting")
    parser.add_argument("--seconds", type=inputs.positive, metavar="S", help="hard limit of the fit (60)")
    add_json_option(parser)
    parser.add_argument("--report", metavar="OUT.html", help="write the page with pictures")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Fit and print the record; 0: a fit, 2: an illegal program, 1: no fit came out; files are written anyway."""
    require_json_place(arguments.json)
    if arguments.report is not None:
        require_place(arguments.report)
    require_distinct(
        {"--json": arguments.json, "--report": arguments.report},
        {"PROGRAM": arguments.program, "DATA": inputs.sweep_file(arguments.data)},
    )
    diagram, sweep = inputs.program(arguments.program), inputs.measured(arguments.data)

    from dataclasses import replace

    from ibrid.evaluation.evaluate import evaluate
    from ibrid.fit.settings import FitSettings

    settings = FitSettings(seeds=arguments.seeds)
    if arguments.seconds is not None:
        settings = replace(settings, seconds=arguments.seconds)
    record = evaluate(
        diagram,
        sweep,
        parameters=arguments.parameters,
        equilibrium=arguments.equilibrium,
        vocabulary=inputs.vocabulary(arguments.vocabulary, arguments.kinds),
        objective=arguments.objective,
        restarts=arguments.restarts,
        seed=arguments.seed,
        holdout_op=arguments.holdout_op,
        port=inputs.port(arguments.port, sweep),
        labels=arguments.labels,
        settings=settings,
    )
    printed = give_json(record.to_json(), arguments.json)
    if arguments.report is not None:
        from ibrid.report.page import write_report

        write_report(record, arguments.report, sweep=sweep)
    if record.outcome != "ok":
        return _say_why(record, arguments.program)
    if not printed:
        from ibrid.report.text import format_record

        print(format_record(record).rstrip("\n"))
    return 0


def _say_why(record: "Record", program: str) -> int:
    for reason in record.reasons:
        complain(f"{program}{', ' if reason.startswith('line ') else ': '}{reason}")
    return 2 if record.outcome == "invalid" else 1
