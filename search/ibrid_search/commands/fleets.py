"""`ibrid fleet FOLDER --out OUT`: the same question to hundreds or thousands of devices, in one
store and on one page.
"""

import os
from argparse import Namespace
from pathlib import Path

from ibrid.commands.outputs import UNFINISHED, give_json, require_json_place
from ibrid.errors import some
from ibrid.streams import complain
from ibrid.telling import telling
from ibrid_search.fleet.running import Earlier, fleet
from ibrid_search.settings import Workers


def run(arguments: Namespace) -> int:
    """Examine, and say what the fleet is like; 0 also where devices have no answer, 3 where one is
    unfinished, 130 when it was stopped.
    """
    require_json_place(arguments.json)
    if arguments.device is not None:
        with Earlier(Path(arguments.out)) as known:
            give_json(known.record(arguments.device).to_json(), arguments.json or "-")
        return 0
    try:
        with telling() as tell:
            survey = fleet(
                arguments.folder,
                arguments.out,
                job=arguments.job,
                before=arguments.before,
                workers=Workers(arguments.workers or os.cpu_count() or 1, arguments.ray),
                seed=arguments.seed,
                budget=arguments.budget,
                effort=arguments.effort,
                resume=arguments.resume,
                tell=tell,
            )
    except KeyboardInterrupt:
        kept = "stopped; every device that was answered is kept, go on with"
        raise KeyboardInterrupt(f"{kept}: {_go_on(arguments)}") from None
    summary = survey.summary
    if not give_json(summary.to_json(), arguments.json):
        print(f"\n{summary.sentence}")
        for family in summary.families[:6]:
            print(f"  {family.devices} of {family.label}")
        print(f"{survey.folder}: devices.csv, report.html; {survey.seconds:.0f} s")
    if unfinished := [one.name for one in summary.devices if one.status == "unfinished"]:
        complain(f"unfinished: {some(unfinished)}; try again with: {_go_on(arguments)}")
        return UNFINISHED
    return 0


def _go_on(arguments: Namespace) -> str:
    return f"ibrid fleet {arguments.folder} --out {arguments.out} --resume (and the same options)"
