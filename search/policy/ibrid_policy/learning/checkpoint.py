"""The state of learning on disk: weights, optimiser, random numbers and how many batches they have
seen, in one file.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.writing import write_whole
from ibrid_policy.backend import read_saved

#: Its name in the folder of a run.
CHECKPOINT = "learning.pt"
VERSION = 1


def write_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Replace the file atomically, so that a killed run finds the state before or after an
    update.
    """
    import torch  # pyright: ignore[reportMissingImports]

    buffer = io.BytesIO()
    torch.save({"version": VERSION, **state}, buffer)
    write_whole(path, buffer.getvalue())


def read_checkpoint(path: Path) -> dict[str, Any] | None:
    """What `write_checkpoint` wrote; None when there is no file. No code in the file is run.

    Raises IbridError when it is damaged or of another version.
    """
    try:
        found = read_saved(path, "restore it, or start a new run")
    except FileNotFoundError:
        return None
    if not isinstance(found, dict) or found.get("version") != VERSION:
        raise IbridError(
            f"{path}: must hold the state of learning, version {VERSION}; restore it, or start a "
            "new run"
        )
    return found
