"""A request that the search of a run end after what is under way: an empty file beside its archive.

Whoever watches a run may be another process than its search, and only one process writes an
archive.
"""

import os
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.writing import inside
from ibrid_search.run.database import is_being_written
from ibrid_search.run.run_folder import ARCHIVE, STOP


def request_stop(folder: Path) -> None:
    """Ask the search that is writing the run in `folder` to stop; asking twice is asking once.

    Raises IbridError where no search is writing it, or the request cannot be written.
    """
    if not is_being_written(inside(folder, ARCHIVE)):
        raise IbridError(f"{folder}: no search is writing this run, so there is none to stop")
    path = inside(folder, STOP)
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except FileExistsError:
        return
    except OSError as error:
        raise IbridError(
            f"{path}: cannot be written ({error.strerror}); stop the search with Ctrl-C"
        ) from None


def is_stop_requested(folder: Path) -> bool:
    """Whether the search of a run was asked to stop since it began."""
    return (folder / STOP).is_file()
