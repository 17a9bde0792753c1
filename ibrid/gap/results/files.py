"""The files of an answer: gap.json, the repaired model as a program, what changed in it, and its
record.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ibrid.gap.results.gap import SCHEMA, Gap
from ibrid.own_files import remove_own, writing_as
from ibrid.structure.comparison.compare import unified
from ibrid.writing import inside, json_lines, plain, write_json, write_whole

GAP, PROGRAM, RECORD, PAGE = "gap.json", "model.py", "model.json", "report.html"
#: What a repair changed; there is none without a repair.
DIFF = "model.diff"
FILES = (PAGE, PROGRAM, DIFF, RECORD, GAP)


def gap_json(gap: Gap) -> dict[str, Any]:
    """Plain data in the contract's order; numbers that are not finite become null."""
    return plain(
        {
            "schema": SCHEMA,
            "verdict": gap.verdict,
            "sentence": gap.sentence,
            "located": [vars(one) for one in gap.located],
            "ports": [
                {"port": one.port.name, "chi2_per_dof": one.chi2_per_dof, "adequate": one.adequate}
                for one in gap.ports
            ],
            "effects": [vars(one) for one in gap.effects],
            "before": gap.before,
            "after": gap.after,
            "noise_floor": gap.noise_floor,
            **({"noise_floor_by_record": dict(gap.events.floors)} if gap.events else {}),
            "noise": gap.noise,
            "moved": [vars(one) for one in gap.moved],
            "could_not_have_seen": [vars(one) for one in gap.could_not_have_seen],
            "candidates": [vars(one) for one in gap.candidates],
            "null_space": gap.null_space,
            "frame_angle": gap.angle,
            "missing_transfer": _missing_transfer(gap),
            "suggested": [vars(one) for one in gap.suggested],
            **_amplitudes(gap),
            "steps": gap.steps,
            "effort": gap.effort,
            "experiments": gap.experiments,
            "complete": gap.complete,
            "program": gap.program,
        }
    )


@writing_as("gap")
def write_gap(gap: Gap, folder: str | Path, given: str = "the given program") -> None:
    """gap.json, model.py, model.json and, after a repair, model.diff in a folder that is there,
    each replaced atomically.

    given : name of the given program in the diff, which begins from its canonical text. Without a
    repair an older diff is taken away.
    """
    folder = Path(folder)
    answer = json_lines(gap_json(gap))
    changed = unified(gap.given, gap.program, (given, str(folder / PROGRAM)))
    write_whole(inside(folder, PROGRAM), gap.program)
    if changed:
        write_whole(inside(folder, DIFF), changed)
    else:
        remove_own(inside(folder, DIFF))
    gap.repaired.write(inside(folder, RECORD))
    write_whole(inside(folder, GAP), answer)


def write_partial(gap: Gap, folder: str | Path) -> None:
    """gap.json of an answer on the way, in a folder that is made where it is not there; replaced
    atomically.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    write_json(inside(Path(folder), GAP), gap_json(gap))


def _missing_transfer(gap: Gap) -> list[dict[str, Any]]:
    """The transfer at the place where something is missing: one complex number per frequency, for
    all operating points.
    """
    transfer = gap.missing_transfer
    if transfer is None:
        return []
    return [
        {
            "port": transfer.fit.port.name,
            "in_series": transfer.fit.port.series,
            "frequency_hz": transfer.fit.frequency.tolist(),
            "value": np.stack([np.real(transfer.value), np.imag(transfer.value)], axis=1).tolist(),
            "sigma": transfer.deviation.tolist(),
        }
    ]


def _amplitudes(gap: Gap) -> dict[str, Any]:
    """What data with several injection amplitudes say beside; nothing where there is one
    amplitude.
    """
    if gap.amplitude is None:
        return {}
    linearity = gap.amplitude.linearity
    return {
        "amplitudes": linearity.amplitudes,
        "amplitude_dependent": [vars(one) for one in linearity.bands],
        "refused_hz": linearity.refused.tolist(),
        "nonlinear_candidates": [vars(one) for one in gap.amplitude.tried],
    }
