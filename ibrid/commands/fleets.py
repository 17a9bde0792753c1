"""`ibrid fleet FOLDER --out OUT`: the same question to hundreds or thousands of devices, in one store and on one page."""

import os
from argparse import Namespace
from typing import Any

from ibrid.commands import inputs
from ibrid.commands.outputs import add_json_option, complain, give_json, require_json_place


def declare(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "fleet", help="start, search or drift for every sweep of a folder: families, outliers, drifts"
    )
    parser.add_argument("folder", metavar="FOLDER", help="sweep files, one a device, also in folders below")
    parser.add_argument(
        "--out", required=True, metavar="OUT", help="the fleet's own folder; a new one, unless --resume"
    )
    parser.add_argument("--job", default="start", help="for each device: start (default) | search | drift")
    parser.add_argument(
        "--before", metavar="OUT", help="of drift: the folder of the fleet as it was, by names of files"
    )
    parser.add_argument("--budget", type=inputs.count, default=40, metavar="N", help="evaluations of each search (40)")
    parser.add_argument("--seed", type=inputs.natural, default=0, metavar="N", help="of everything random (0)")
    parser.add_argument("--workers", type=inputs.count, metavar="N", help="so many processes (all cores)")
    parser.add_argument("--ray", metavar="ADDRESS", help="workers on a Ray cluster: auto, or HEAD:6379")
    parser.add_argument(
        "--seconds", type=inputs.positive, default=300.0, metavar="S", help="after which a device is given up (300)"
    )
    parser.add_argument("--resume", action="store_true", help="go on with the fleet in OUT; new files are new devices")
    parser.add_argument("--device", metavar="NAME", help="examine nothing: the record of this device of OUT, as --json")
    add_json_option(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Examine, and say what the fleet is like; 0 also where devices have no answer, 1 when it was stopped."""
    from pathlib import Path

    from ibrid_search.fleet.running import Earlier, fleet
    from ibrid_search.settings import Workers

    from ibrid.telling import telling

    require_json_place(arguments.json)
    if arguments.device is not None:
        with Earlier(Path(arguments.out)) as known:
            give_json(known.record(arguments.device).to_json(), arguments.json or "-")
        return 0
    try:
        with telling() as tell:
            found = fleet(
                arguments.folder,
                arguments.out,
                job=arguments.job,
                before=arguments.before,
                workers=Workers(arguments.workers or os.cpu_count() or 1, arguments.ray),
                seed=arguments.seed,
                budget=arguments.budget,
                wall=arguments.seconds,
                resume=arguments.resume,
                tell=tell,
            )
    except KeyboardInterrupt:
        complain(
            f"stopped; every device that was answered is kept, go on with: ibrid fleet {arguments.folder} --out {arguments.out} "
            "--resume (and the same options)"
        )
        return 1
    summary = found.summary
    if not give_json(summary.to_json(), arguments.json):
        print(f"\n{summary.sentence}")
        for family in summary.families[:6]:
            print(f"  {family.devices} of {family.label}")
        print(f"{found.folder}: devices.csv, report.html; {found.seconds:.0f} s")
    return 0
