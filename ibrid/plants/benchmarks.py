"""Where the data that ship with ibrid lie."""

from collections.abc import Mapping
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.frozen import FrozenDict


def benchmarks() -> Mapping[str, Path]:
    """Name -> CSV file of every shipped sweep, in the repository or in an installed package.

    Raises IbridError when the data folder is missing.
    """
    return FrozenDict({path.stem: path for path in sorted(_data_folder().glob("*.csv"))})


def examples() -> Mapping[str, Path]:
    """Name -> file or folder of every shipped example, as in data/examples of the repository.

    Files are named with their ending ("scan.xlsx"); a folder ("hidden_loop") holds what belongs to
    one device.

    Raises IbridError when the data folder is missing.
    """
    return FrozenDict({path.name: path for path in sorted((_data_folder() / "examples").iterdir())})


def _data_folder() -> Path:
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "data", package.parent / "data"):
        if (folder / "paper_like.csv").is_file():
            return folder
    raise IbridError(
        f"the shipped sweeps must lie in {package / 'data'} or {package.parent / 'data'}; neither "
        "has paper_like.csv, "
        "install ibrid again or run python data/make_data.py in the repository."
    )
