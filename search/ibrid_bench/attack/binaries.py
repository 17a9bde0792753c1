"""MAT files with a few bytes changed or cut off: each is a sweep or a sentence, whatever the reader of others does."""

import io
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from ibrid.errors import SweepError
from ibrid.measurement.matlab import read_mat


def whole_files() -> list[bytes]:
    """Of the formats 5, compressed and not, and 4."""
    rng = np.random.default_rng(0)
    variables = {"w": np.geomspace(10, 1e4, 16), "Y": rng.normal(size=(2, 2, 16)) + 1j, "p": 1.0, "q": 0.3, "op": "a"}
    files = []
    choices: tuple[dict[str, Any], ...] = ({"do_compression": True}, {}, {"format": "4"})
    for options in choices:
        stream, kept = io.BytesIO(), dict(variables)
        if "format" in options:
            del kept["Y"]
        savemat(stream, kept, **options)
        files.append(stream.getvalue())
    return files


def binaries_tried(folder: Path, number: int, seed: int) -> Iterator[str]:
    """Read so many changed files; yields what was neither a sweep nor a sentence."""
    rng, files, path = random.Random(seed), whole_files(), folder / "scan.mat"
    for index in range(number):
        content = bytearray(files[index % len(files)])
        for _ in range(rng.randint(1, 8)):
            content[rng.randrange(len(content))] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        if rng.random() < 0.2:
            del content[rng.randrange(len(content)) :]
        path.write_bytes(content)
        try:
            read_mat(path)
        except SweepError as error:
            if len(str(error).splitlines()) != 1:
                yield f"file {index}: {error}"
        except Exception as error:
            yield f"file {index}: {type(error).__name__}: {error}"
