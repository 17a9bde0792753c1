"""Under which conditions a case is recorded, by its number: all kinds of recorders, edges and
noises of the trade.
"""

from dataclasses import dataclass

import numpy as np
from ibrid_bench.events.recorder import Recorder

#: Of voltage and current below what happens in it, dB; None: a clean record of a simulation.
LEVELS = (None, 80.0, 60.0, 40.0)
#: Samples per s; how often each.
RATES, OFTEN = (1000.0, 2000.0, 5000.0, 10_000.0, 20_000.0), (0.1, 0.1, 0.4, 0.2, 0.2)
#: Edges, s, from and to.
RISES = (5e-5, 3e-3)
#: Samples per s of a program of fixed steps, and how often a clean record is that of one.
STEPPED, PROGRAMS = 20_000.0, 0.3
#: Offset and unbalance of the channels of one that records phases.
OFFSET, UNBALANCE = 5e-4, 5e-4


@dataclass(frozen=True)
class Conditions:
    """`swept` : with a sweep beside the recordings. `rise` : of the edges of events, s."""

    recorder: Recorder
    swept: bool
    rise: float

    @property
    def noise_db(self) -> float | None:
        """Of the current below what happens in it."""
        return self.recorder.noise_db


def conditions(kind: int, seed: int) -> Conditions:
    """Of a case of a kind by its number: the noises in turn, with and without a sweep, the rest
    drawn.
    """
    rng = np.random.default_rng([seed, 65, kind])
    noise_db, swept = LEVELS[seed % 4], bool(seed // 4 % 2)
    rate = float(rng.choice(RATES, p=OFTEN))
    phases = bool(rng.random() < 0.4)
    recorder = Recorder(
        rate,
        frame="abc" if phases else "dq",
        bits=None if noise_db is None else (16, 12)[int(noise_db <= 60.0 and rng.random() < 0.5)],
        filtered=bool(rng.random() < 0.3),
        noise_db=noise_db,
        offset=OFFSET * phases * (noise_db is not None),
        unbalance=UNBALANCE * phases * (noise_db is not None),
    )
    rise = float(np.exp(rng.uniform(*np.log(RISES))))
    if noise_db is None and rng.random() < PROGRAMS:
        recorder = Recorder(STEPPED, program=True)
    return Conditions(recorder, swept, rise)
