"""`ibrid report RUN` and `ibrid next RUN`: what is made from the folder of a search."""

from argparse import Namespace
from pathlib import Path

from ibrid.commands import inputs
from ibrid.evaluation.record import Record
from ibrid.modules.vocabulary import choose_vocabulary
from ibrid.own_files import also_reading
from ibrid.writing import inside, require_place
from ibrid_search.report.page import write_run_page
from ibrid_search.run.run_folder import ARCHIVE, adopt_run, run_meta
from ibrid_search.selection.rivals import open_structures


def report_run(arguments: Namespace) -> int:
    """The page of a search, also while it runs."""
    folder = Path(arguments.record)
    adopt_run(folder)
    out = inside(folder, "report.html") if arguments.out is None else arguments.out
    also_reading({"the archive": inside(folder, ARCHIVE)})
    inputs.also_reading_data("the run's", run_meta(folder))
    require_place(out)
    sweep = inputs.data(arguments.data) if arguments.data is not None else None
    kinds = choose_vocabulary(inputs.vocabulary(files=arguments.kinds))
    print(write_run_page(folder, out, sweep=sweep, vocabulary=kinds))
    return 0


def open_structures_of(arguments: Namespace) -> tuple[tuple[str, ...], tuple[Record, ...]]:
    """Names and records of the structures that the data leave open."""
    inputs.also_reading_data("the run's", run_meta(Path(arguments.record)))
    return open_structures(
        Path(arguments.record), choose_vocabulary(inputs.vocabulary(files=arguments.kinds))
    )
