"""Binary files of others with a few bytes changed or cut off: each is data or a sentence, whatever
the reader of others does.
"""

import io
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from ibrid.errors import SweepError
from ibrid.measurement.importing.matlab import read_mat
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.read_events import read_events

#: Eight channels of a COMTRADE record: what is read is three voltages and three currents.
_CHANNELS = ("VA", "VB", "VC", "IA", "IB", "IC")
_CFG = (
    "station,recorder,1999\n6,6A,0D\n"
    + "".join(
        f"{number},{name},,,{name[0].replace('I', 'A')},0.1,0,0,-32767,32767,1,1,P\n"
        for number, name in enumerate(_CHANNELS, 1)
    )
    + "50\n1\n5000,500\n01/02/2024,10:20:30.000000\n01/02/2024,10:20:30.100000\nBINARY\n1\n"
)


def whole_files() -> list[tuple[str, bytes, Callable[[Path], object]]]:
    """Suffix, content and reader: MAT 5 compressed and not, MAT 4, HDF5, a workbook, Parquet,
    COMTRADE.
    """
    import h5py
    import pandas as pd

    rng = np.random.default_rng(0)
    variables: dict[str, Any] = {
        "w": np.geomspace(10, 1e4, 16),
        "Y": rng.normal(size=(2, 2, 16)) + 1j,
        "p": 1.0,
        "q": 0.3,
        "op": "a",
    }
    flat = {name: value for name, value in variables.items() if name != "Y"}
    streams = [io.BytesIO() for _ in range(6)]
    savemat(streams[0], variables, do_compression=True)
    savemat(streams[1], variables)
    savemat(streams[2], flat, format="4")
    with h5py.File(streams[3], "w") as file:
        for name, value in variables.items():
            file[name] = value
    table = pd.DataFrame(
        {"f": np.geomspace(1, 1000, 16), **{f"Y{k}": rng.normal(size=16) for k in range(8)}}
    )
    table.to_excel(streams[4], index=False)
    table.to_parquet(streams[5])
    suffixes: tuple[tuple[str, Callable[[Path], object]], ...] = (
        ("mat", read_mat),
        ("mat", read_mat),
        ("mat", read_mat),
        ("h5", read_tables),
        ("xlsx", read_tables),
        ("parquet", read_tables),
    )
    files = [
        (suffix, stream.getvalue(), read)
        for (suffix, read), stream in zip(suffixes, streams, strict=True)
    ]
    return [*files, ("cff", _comtrade(), _read_comtrade)]


def binaries_tried(folder: Path, number: int, seed: int) -> Iterator[str]:
    """Read so many changed files; yields what was neither data nor a sentence."""
    rng, files = random.Random(seed), whole_files()
    for index in range(number):
        suffix, whole, read = files[(seed + index) % len(files)]
        content, path = bytearray(whole), folder / f"scan.{suffix}"
        for _ in range(rng.randint(1, 8)):
            content[rng.randrange(len(content))] = rng.choice(
                (0, 1, 127, 128, 255, rng.randrange(256))
            )
        if rng.random() < 0.2:
            del content[rng.randrange(len(content)) :]
        path.write_bytes(content)
        try:
            read(path)
        except SweepError as error:
            if len(str(error).splitlines()) != 1:
                yield f"{path.name} {index}: {error}"
        except Exception as error:
            yield f"{path.name} {index}: {type(error).__name__}: {error}"


def _comtrade() -> bytes:
    """Both parts in one file; a dip to 0.6 in 0.1 s at 5 kHz."""
    time = np.arange(500) / 5000
    size = np.where((time > 0.05) & (time < 0.08), 600.0, 1000.0)
    turns = [size * np.cos(2 * np.pi * (50 * time - k / 3)) for k in (0, 1, 2, 0, 1, 2)]
    rows = np.zeros(500, dtype=[("number", "<u4"), ("stamp", "<u4"), ("value", "<i2", 6)])
    rows["number"], rows["stamp"], rows["value"] = (
        np.arange(1, 501),
        np.round(time * 1e6),
        np.transpose(turns),
    )
    data = rows.tobytes()
    parts = (b"--- file type: CFG ---\r\n", _CFG.replace("\n", "\r\n").encode())
    return b"".join((*parts, b"--- file type: DAT BINARY: %d ---\r\n" % len(data), data))


def _read_comtrade(path: Path) -> object:
    return read_events(path, s_base_va=1e5, v_base_v=100.0)
