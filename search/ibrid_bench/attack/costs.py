"""What refusing costs: illegal programs, tables of a million rows, a line that does not end."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from ibrid_bench.attack.programs import EVIL

from ibrid.errors import IbridError
from ibrid.measurement.read import read_sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.compiling.check import examine
from ibrid.structure.diagrams.program import parse_program

#: Seconds for an illegal program, for a million rows, and for a line of 40 MB.
PROGRAM, ROWS, LINE = 1.0, 10.0, 1.0
_HEAD = "op,p,q,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im\n"


def costs(folder: Path) -> Iterator[tuple[str, float, float]]:
    """(what, seconds of computation, seconds at most)."""
    for what, make in EVIL.items():
        diagram = make()
        seconds = _seconds(lambda diagram=diagram: examine(diagram, VOCABULARY))
        if examine(diagram, VOCABULARY)[0]:
            yield what, seconds, PROGRAM
    lines = "".join(f'    g.add("Gainn_dq", "g{index}")\n' for index in range(100_000))
    yield (
        "100,000 modules of no kind",
        _seconds(lambda: parse_program(f"def build(g):\n{lines}")),
        PROGRAM,
    )
    rows = folder / "rows.csv"
    frequency = np.geomspace(1, 1e4, 1_000_000)
    numbers = ",0.5,-0.1,0.2,0.1,0.3,0.1,0.5,-0.2\n"
    rows.write_text(_HEAD + "".join(f"a,1,0,{one!r}{numbers}" for one in frequency.tolist()))
    yield "a million rows", _seconds(lambda: read_sweep(rows)), ROWS
    line = folder / "line.csv"
    line.write_text(_HEAD + "1," * 20_000_000)
    yield "a line of 40 MB", _seconds(lambda: read_sweep(line)), LINE


def _seconds(action: Callable[[], object]) -> float:
    started = time.process_time()
    with contextlib.suppress(IbridError):
        action()
    return time.process_time() - started
