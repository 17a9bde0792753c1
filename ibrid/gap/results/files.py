"""The files of a `Gap`: gap.json, the repaired program, its diff, and its record."""

from pathlib import Path

import numpy as np

from ibrid.gap.results.gap import SCHEMA, Gap
from ibrid.own_files import remove_own, writing_as
from ibrid.structure.comparison.compare import unified
from ibrid.writing import PlainData, inside, json_lines, plain, write_json, write_whole

GAP = "gap.json"
PROGRAM = "model.py"
RECORD = "model.json"
PAGE = "report.html"
#: What a repair changed; there is none without a repair.
DIFF = "model.diff"
FILES = (PAGE, PROGRAM, DIFF, RECORD, GAP)


def gap_json(gap: Gap) -> PlainData:
    """Return the contents of gap.json; numbers that are not finite become null."""
    return plain(
        {
            "schema": SCHEMA,
            "verdict": gap.verdict,
            "sentence": gap.sentence,
            "located": [vars(part) for part in gap.located],
            "ports": [
                {"port": fit.port.name, "chi2_per_dof": fit.chi2_per_dof, "adequate": fit.adequate}
                for fit in gap.ports
            ],
            "effects": [vars(effect) for effect in gap.effects],
            "before": gap.before,
            "after": gap.after,
            "noise_floor": gap.noise_floor,
            **({"noise_floor_by_record": dict(gap.events.floors)} if gap.events else {}),
            "noise": gap.noise,
            "moved": [vars(change) for change in gap.moved],
            "could_not_have_seen": [vars(effect) for effect in gap.could_not_have_seen],
            "candidates": [vars(candidate) for candidate in gap.candidates],
            "null_space": gap.null_space,
            "frame_angle": gap.angle,
            "missing_transfer": _missing_transfer(gap),
            "suggested": [vars(edit) for edit in gap.suggested],
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
    """Write gap.json, model.py, model.json and, after a repair, model.diff, each atomically.

    Without a repair an older model.diff is removed.

    Parameters
    ----------
    folder : str or Path
        Exists.
    given : str
        Name of the given program in the diff, which begins from its canonical text.
    """
    folder = Path(folder)
    gap_text = json_lines(gap_json(gap))
    changed = unified(gap.given, gap.program, (given, str(folder / PROGRAM)))
    write_whole(inside(folder, PROGRAM), gap.program)
    if changed:
        write_whole(inside(folder, DIFF), changed)
    else:
        remove_own(inside(folder, DIFF))
    gap.repaired.write(inside(folder, RECORD))
    write_whole(inside(folder, GAP), gap_text)


def write_partial(gap: Gap, folder: str | Path) -> None:
    """Write gap.json of an intermediate result atomically; the folder is made where missing."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    write_json(inside(Path(folder), GAP), gap_json(gap))


def _missing_transfer(gap: Gap) -> list[PlainData]:
    """Return the transfer function at the port where something is missing, by frequency.

    One for all operating points; [] where there is none.
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


def _amplitudes(gap: Gap) -> PlainData:
    """Return the keys for several injection amplitudes; {} with one amplitude."""
    if gap.amplitude is None:
        return {}
    linearity = gap.amplitude.linearity
    return {
        "amplitudes": linearity.amplitudes,
        "amplitude_dependent": [vars(band) for band in linearity.bands],
        "refused_hz": linearity.refused.tolist(),
        "nonlinear_candidates": [vars(trial) for trial in gap.amplitude.tried],
    }
