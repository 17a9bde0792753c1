"""torch and transformers, imported when a policy runs and never before."""

import importlib
import io
import pickle
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError


def require(package: str) -> Any:
    """The package; IbridError, naming what to install, where it is missing."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise IbridError(
            f"the policy needs the package {package}; pip install 'ibrid[local-llm]', after a "
            "build of torch for this machine"
        ) from None


def read_saved(path: Path, remedy: str) -> Any:
    """What torch saved in a file, on the CPU; no code in the file is run.

    Raises FileNotFoundError, and IbridError, which ends with the remedy, when the file is damaged.
    """
    try:
        return require("torch").load(
            io.BytesIO(path.read_bytes()), map_location="cpu", weights_only=True
        )
    except FileNotFoundError:
        raise
    except (
        OSError,
        EOFError,
        RuntimeError,
        ValueError,
        pickle.UnpicklingError,
        zipfile.BadZipFile,
    ) as error:
        raise IbridError(
            f"{path}: cannot be read ({' '.join(str(error).split())[:120]}); {remedy}"
        ) from None


@contextmanager
def threads(number: int) -> Iterator[None]:
    """Within, torch computes with so many threads on the CPU."""
    torch = require("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def device() -> str:
    """A GPU that torch finds, else the CPU."""
    return "cuda" if require("torch").cuda.is_available() else "cpu"


def read_so_far(answer: Any) -> dict[str, Any]:
    """What a causal model has read, as an argument of its next call: `cache`, or `past_key_values`
    before transformers 5.24.
    """
    name = "cache" if hasattr(answer, "cache") else "past_key_values"
    return {name: getattr(answer, name)}
