"""`ibrid start DATA`: from a file to a first answer, with a page and the commands that go on from there."""

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from ibrid.commands import inputs
from ibrid.commands.outputs import complain
from ibrid.errors import SweepError

if TYPE_CHECKING:
    from pathlib import Path

    from ibrid.measurement.sweep import Sweep


def declare(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "start", help="first answer about a sweep: what is odd, which shipped diagram fits, what next"
    )
    parser.add_argument("data", metavar="DATA", help=inputs.DATA_HELP)
    parser.add_argument("--seed", type=inputs.natural, default=0, metavar="N", help="of the random starts (0)")
    inputs.add_port_option(parser)
    parser.add_argument(
        "--out", metavar="DIR", help="folder for the page, the model and start.json (DATA's name and _start)"
    )
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Answer, write the folder, and print the sentence, the ranking and the commands."""
    from pathlib import Path

    from ibrid.telling import telling
    from ibrid.writing import aligned, require_folder

    folder = Path(arguments.out or f"{Path(arguments.data).stem}_start")
    require_folder(folder)
    sweep, data = _data(arguments.data, folder)

    from ibrid_search.start import start, write_start

    folder.mkdir(parents=True, exist_ok=True)
    with telling() as tell:
        answer = start(sweep, tell=tell, seed=arguments.seed, port=inputs.port(arguments.port, sweep))
    answer = write_start(answer, data, folder, arguments.port)
    for warning in answer.inspection.warnings:
        complain(f"mind: {warning}")
    print(answer.sentence)
    print()
    rows = [(ranked.diagram, ranked.grade or "looked at", f"NRMSE {ranked.nrmse:.3g}") for ranked in answer.ranked[:6]]
    print(aligned(rows))
    print(f"\nnext (page: {folder / 'report.html'}):")
    for line in answer.next:
        print(f"  {line}")
    return 0


def _data(text: str, folder: "Path") -> "tuple[Sweep, str]":
    """The sweep, and how commands name it; a foreign table is imported into the folder where its words suffice."""
    try:
        return inputs.data(text), text
    except SweepError as refused:
        from ibrid.measurement.csv_file import write_sweep
        from ibrid.measurement.importing import import_files

        if inputs.sweep_file(text) is None:
            raise
        try:
            imported = import_files([text])
        except SweepError:
            raise refused from None
        if imported.sweep is None:
            raise SweepError(
                f"{imported.asked} Say it to ibrid import {text} --out sweep.csv, then start on that."
            ) from None
        for remark in imported.remarks:
            complain(f"mind: {remark}")
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "sweep.csv"
        write_sweep(imported.sweep, file)
        return inputs.data(str(file)), str(file)
