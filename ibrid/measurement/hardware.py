"""Where published hardware sweeps lie; they are not part of the package (see data/README.md)."""

import os
from pathlib import Path

VARIABLE = "IBRID_HARDWARE_DATA"
FOLDER = "virginia_tech_gti"
NAMES = ("gti_pq", "gti_ki20")


def hardware_sweeps() -> dict[str, Path]:
    """The hardware sweeps found on this machine, by name (gti_pq, gti_ki20); empty where they are
    not.

    Looked for in the folder named by the environment variable IBRID_HARDWARE_DATA, else in
    ../shared/data beside the repository; in either, the files lie in virginia_tech_gti or directly.
    """
    root = os.environ.get(VARIABLE)
    base = Path(root) if root else Path(__file__).resolve().parents[2].parent / "shared" / "data"
    places = [(name, folder / f"{name}.csv") for name in NAMES for folder in (base, base / FOLDER)]
    return {name: path for name, path in places if path.is_file()}
