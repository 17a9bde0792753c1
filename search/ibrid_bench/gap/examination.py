"""One trial from the draw to the score: the case is written, another process answers it blindly,
the answer is scored.
"""

import shutil
from dataclasses import asdict
from pathlib import Path

from ibrid_bench.gap.detection import visibilities
from ibrid_bench.gap.diagnosis import Diagnose, diagnose
from ibrid_bench.gap.scoring import Row, score
from ibrid_bench.gap.trials import Trial
from ibrid_bench.hidden.case import write_case

from ibrid.fit import kernel


def examine(trial: Trial, out: Path, *, answer: Diagnose = diagnose, keep: bool = False) -> Row:
    """The row of a trial; plain data with its key.

    Folders below `out`: cases/TRIAL holds what the diagnosing process gets, and its answer;
    truths/TRIAL the truth. Both are removed unless they are to be kept. Raises IbridError when the
    trial cannot be drawn or its files not be written.
    """
    kernel.load()
    folder, truth = out / "cases" / trial.folder, out / "truths" / trial.folder
    for place in (folder, truth):
        shutil.rmtree(place, ignore_errors=True)  # of a trial that was stopped
    write_case(trial.case(), folder, truth)
    diagnosis = answer(folder)
    measured = trial.stated_case()
    seen = visibilities(measured, trial.clean_case(), trial.seed)
    if not keep:
        for place in (folder, truth):
            shutil.rmtree(place, ignore_errors=True)
    return {
        "key": trial.key,
        **asdict(trial),
        "data": trial.data,
        **score(measured, diagnosis, seen),
    }
