"""`ibrid next RECORD|RUN` and `ibrid drift RECORD DATA`: what to measure next, and what changed
since.
"""

from argparse import Namespace
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibrid.commands import inputs
from ibrid.commands.outputs import give_json, require_json_place
from ibrid.errors import IbridError
from ibrid.foreign_data import text_in, toml_in
from ibrid.own_files import DATABASE
from ibrid.plugins import command
from ibrid.ranges import require_in_range

if TYPE_CHECKING:
    from ibrid.analysis.new_data.experiments import Among


def run_next(arguments: Namespace) -> int:
    """Print the ranking, or its JSON."""
    require_json_place(arguments.json)
    among = _among(arguments.among)

    from ibrid.analysis.new_data.experiments import experiments, sentences, with_twins
    from ibrid.report.texts.experiments_text import format_experiments

    source = Path(arguments.record)
    if (source / DATABASE).is_file():
        names, records = command("search:reporting.open_structures_of")(arguments)
    else:
        from ibrid.structure.compiling.canonical import structure_hash

        record = inputs.record(source, arguments.kinds)
        names, records = (structure_hash(record.diagram, record.vocabulary),), (record,)
    names, records = (names[:1], records[:1]) if among.parameters else with_twins(names, records)
    ranking = experiments(records, names, among)
    said = sentences(ranking, among)
    content = {
        "schema": "ibrid.next/1",
        "experiments": [one.plain() for one in ranking],
        "sentences": list(said),
    }
    if not give_json(content, arguments.json):
        print(format_experiments(ranking, said, among.parameters))
    return 0


def run_drift(arguments: Namespace) -> int:
    """Print the answer, or its JSON; 0 whatever the answer."""
    require_json_place(arguments.json)

    from ibrid.analysis.new_data.drift import drift
    from ibrid.analysis.several_devices.collector_file import read_collector

    record = inputs.record(arguments.record, arguments.kinds)
    if inputs.holds_events(arguments.data):
        inputs.require_no_plant(arguments)
        change = drift(record, inputs.events(arguments.data, inputs.said_of_events(arguments)))
    else:
        inputs.require_no_events_options(arguments)
        sweep = inputs.measured(arguments.data)
        change = drift(
            record, sweep, read_collector(arguments.port, sweep) if arguments.port else None
        )
    if not give_json(change.plain(), arguments.json):
        print(f"{change.verdict}: {change.sentence}")
    return 0


def _among(path: str | None) -> "Among":
    from ibrid.analysis.new_data.experiments import Among

    if path is None:
        return Among()
    try:
        content = toml_in(text_in(Path(path)))
    except (OSError, ValueError) as error:
        raise IbridError(
            f"{path}: must be toml such as p = [0, 0.5, 1] and count = 8 ({error})"
        ) from None
    known = {one.name for one in fields(Among)} - {"of"}
    if strange := sorted(set(content) - known):
        raise IbridError(f"{path}: knows {', '.join(sorted(known))}, found {', '.join(strange)}")
    return Among(**{name: _checked(path, name, value) for name, value in content.items()})


def _checked(path: str, name: str, value: Any) -> Any:
    """A list of numbers for p, q, v; a positive number for the others, a whole one up to 200 for
    count.
    """
    if name in ("p", "q", "v"):
        numbers = value if isinstance(value, list) else [value]
        plain = all(
            isinstance(one, int | float) and not isinstance(one, bool) and abs(one) <= 10
            for one in numbers
        )
        if plain and 0 < len(numbers) <= 20 and (name != "v" or min(numbers) > 0):
            return tuple(float(one) for one in numbers)
        raise IbridError(
            f"{path}: {name} must be one to twenty numbers within 10 per unit, found "
            f"{str(value)[:60]}"
        )
    if name in ("events", "parameters"):
        from ibrid.analysis.new_data.event_answers import event_to_rank

        known = event_to_rank if name == "events" else bool
        if (
            isinstance(value, list)
            and len(value) <= 50
            and all(isinstance(one, str) and known(one) for one in value)
        ):
            return tuple(value)
        such = '["dip:0.6", "phase:20"]' if name == "events" else '["pll.kI_pll"]'
        raise IbridError(f"{path}: {name} must be a list such as {such}, found {str(value)[:60]}")
    if name == "count":
        if isinstance(value, int) and not isinstance(value, bool) and 0 < value <= 200:
            return value
        raise IbridError(
            f"{path}: count must be a whole number from 1 to 200, found {str(value)[:60]}"
        )
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1e9:
        range_of = "relative_noise" if name in ("noise", "record_noise") else "freq_hz"
        require_in_range(range_of, value, f"{path}: {name}", IbridError)
        return float(value)
    raise IbridError(f"{path}: {name} must be a positive number, found {value!r:.60}")
