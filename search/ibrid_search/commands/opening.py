"""`ibrid open DEVICE.toml --out RUN`: a model file, identified by experiments that are chosen."""

from argparse import Namespace
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.streams import complain


def run(arguments: Namespace) -> int:
    """Open the device and say what was found; 130 when stopped."""
    from ibrid.devices.device_file import read_device
    from ibrid.measurement.sweeps.quantities import counted
    from ibrid.telling import telling
    from ibrid_search.opening.open_device import open_device
    from ibrid_search.opening.story import STORY

    folder = Path(arguments.out)
    device = read_device(arguments.device)
    if device.kind != "reference":
        complain(f"runs {device.path} in a process of its own")
    go_on = f"go on with: ibrid open {arguments.device} --out {folder} --resume (same options)"
    try:
        with telling() as tell:
            story = open_device(
                device,
                folder,
                points=arguments.op or (),
                budget=arguments.budget,
                gain=arguments.gain,
                effort=arguments.effort,
                seed=arguments.seed,
                resume=arguments.resume,
                tell=tell,
            )
    except KeyboardInterrupt:
        begun = (folder / STORY).is_file()
        raise KeyboardInterrupt(f"stopped; {go_on}" if begun else "") from None
    except IbridError as error:
        if arguments.resume or not (folder / STORY).is_file():
            raise
        raise IbridError(f"{error}; what was measured is kept in {folder}") from None
    for number, experiment in enumerate(story.experiments, 1):
        what = f"{experiment.event or 'sweep'} at {experiment.op}"
        if experiment.refused:
            print(f"{number:2}. {what}: not measured, {experiment.refused}")
            continue
        print(f"{number:2}. {what}: {experiment.why}")
        for sentence in experiment.ruled_out:
            print(f"    - {sentence}")
    print(f"\n{counted(len(story.experiments), 'experiment')}; it ended because {story.ending}.")
    print(f"grade: {story.answer['grade']}, NRMSE {story.answer['nrmse']:.3g}")
    if sentence := story.answer["limits"].get("sentence"):
        print(f"limits: {sentence}")
    for name, held_out in story.held_out.items():
        error = held_out["nrmse"]
        words = held_out["refused"] if error is None else f"error {error:.3g}"
        print(f"held-out {name} ({held_out['event'] or 'sweep'} at {held_out['op']}): {words}")
    print(f"\n{folder}: story.json, model.py, model.json, report.html")
    return 0
