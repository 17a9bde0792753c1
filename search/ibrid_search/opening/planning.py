"""Which experiment of a device comes next, and why."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.analysis.new_data.experiments import (
    DECISIVE,
    SLIGHT,
    Among,
    experiments,
    hopeless,
    short_name,
    with_twins,
)
from ibrid.analysis.new_data.experiments import Experiment as Ranked
from ibrid.devices.device_file import DeviceFile
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.operating_points import operating_point
from ibrid_search.opening.story import DeviceExperiment
from ibrid_search.opening.structures import Structures

#: The coarse sweep: two set points that differ in p and q, and frequencies.
COARSE = ("p=0.8,q=0.2", "p=0.3,q=-0.1")
LOWEST, HIGHEST, COUNT = 2.0, 2000.0, 30
#: Samples in the shortest period: with fewer the voltage between samples is part of the answer.
SAMPLES = 10
#: A dip in which the current of most inverters reaches its limit.
DEEP = "dip:0.3"
#: Operating points, events and steps among which the next experiment is chosen; the steps lead to
#: values that no point has.
P, Q = (0.1, 0.5, 0.9), (-0.3, 0.3)
EVENTS = ("dip:0.7", "phase:20")
SET_POINT_STEPS = {"p_ref": "p_ref:0.4", "q_ref": "q_ref:0.1"}
#: What no fit sees: the first event whose kind was not measured, and a step of p_ref, or of the
#: voltage where the device takes none.
HELD_EVENTS = ("dip:0.85", "phase:12", "swell:1.1")
STEP, VOLTAGE_STEP = 0.1, "step:0.03"


@dataclass(frozen=True)
class Plan:
    """experiment : None where nothing is worth it, which `ending` says."""

    experiment: DeviceExperiment | None
    ending: str = ""


def frequencies_for(device: DeviceFile, *, count: int = COUNT) -> tuple[float, ...]:
    """Frequencies of a sweep of the device, Hz."""
    highest = min(HIGHEST, 1.0 / device.step_s / SAMPLES)
    return tuple(float(f"{hz:.4g}") for hz in np.geomspace(LOWEST, highest, count))


def coarse_sweeps(device: DeviceFile, points: Sequence[str]) -> tuple[DeviceExperiment, ...]:
    """Experiments that begin the story."""
    why = (
        "the coarse sweep, from which the first structure is identified",
        "a second set point, at which the parameters that do not depend on it must be the same",
    )
    frequency = frequencies_for(device)
    return tuple(
        DeviceExperiment("sweep", op, why[min(number, 1)], frequencies=frequency)
        for number, op in enumerate(points)
    )


def deep_dip(op: str) -> DeviceExperiment:
    """An event that reaches limits, which no sweep shows."""
    why = (
        "small signals reach no limit: a deep dip shows whether a current limit or another "
        "nonlinear element acts"
    )
    return DeviceExperiment("event", op, why, DEEP)


def choose_experiment(
    device: DeviceFile,
    known: Structures,
    done: Sequence[DeviceExperiment],
    points: Sequence[str],
    gain: float,
) -> Plan:
    """What `ibrid next` ranks first among what the device can do and was not done.

    gain : bits between the structures that are told apart least, or bits on each parameter where
    none is a rival, below which nothing is measured.
    """
    can_move = {"p_ref", "q_ref"} <= set(device.references)
    rests = [operating_point(op) for op in points]
    steps = [step for role, step in SET_POINT_STEPS.items() if role in device.references]
    among = Among(
        p=P if can_move else (rests[0].p,),
        q=Q if can_move else (rests[0].q,),
        v=(rests[0].v,),
        count=16,
        low=LOWEST,
        high=frequencies_for(device)[-1],
        events=(*EVENTS, *steps),
    )
    names, records = with_twins(known.names, known.records)
    try:
        ranking = experiments(records, names, among)
    except IbridError as error:
        return Plan(None, f"nothing can be ranked: {error}")
    before = {(earlier.kind, earlier.op, earlier.event) for earlier in done}
    new = [ranked for ranked in ranking if _key(ranked) not in before]
    if not new:
        return Plan(None, "every experiment among those that are ranked was made")
    best = new[0]
    ending = _not_worth_it(best, ranking, gain)
    if ending:
        return Plan(None, ending)
    kind, op, event = _key(best)
    separates = tuple((short_name(a), short_name(b), bits) for a, b, bits in best.separates)
    why = _why(best, hopeless(ranking))
    frequencies = best.frequencies
    return Plan(DeviceExperiment(kind, op, why, event, frequencies, separates))


def _not_worth_it(best: Ranked, ranking: Sequence[Ranked], gain: float) -> str:
    """Why the best experiment is not made; "" where it is."""
    if not best.separates:
        each = best.information / max(len(best.gain), 1)
        if each >= gain:
            return ""
        return f"the best experiment promises {each:.2g} bits on each parameter, less than {gain:g}"
    promised = best.decides(hopeless(ranking))
    if promised >= gain:
        return ""
    most = max(ranked.decides() for ranked in ranking)
    if most < SLIGHT:
        return (
            "no experiment among those that are ranked tells the structures that are open from "
            "one another"
        )
    return (
        f"the best experiment promises {promised:.2g} bits between the structures that are open, "
        f"less than {gain:g}"
    )


def held_out_experiments(
    device: DeviceFile, done: Sequence[DeviceExperiment]
) -> tuple[DeviceExperiment, ...]:
    """One sweep, one event and one step at an operating point that no fit saw; of a device without
    references at its own, at other frequencies.
    """
    swept = [earlier for earlier in done if earlier.file and earlier.kind == "sweep"]
    rests = [operating_point(earlier.op) for earlier in swept]
    op = done[0].op
    if {"p_ref", "q_ref"} <= set(device.references):
        # half as far as the mean, which no grid of the ranking meets
        p = float(np.mean([rest.p for rest in rests]))
        q = float(np.mean([rest.q for rest in rests]))
        op = f"p={0.9 * p + 0.013:.3f},q={0.9 * q + 0.007:.3f},v={rests[0].v:g}"
    kinds = {earlier.event.partition(":")[0] for earlier in done}
    unseen = [event for event in HELD_EVENTS if event.partition(":")[0] not in kinds]
    event = unseen[0] if unseen else "swell:1.08"
    step = VOLTAGE_STEP
    if "p_ref" in device.references:
        step = f"p_ref:{operating_point(op).p + STEP:.3f}"
    grid = np.array(frequencies_for(device, count=COUNT + 1))
    between = tuple(float(f"{hz:.4g}") for hz in np.sqrt(grid[1:] * grid[:-1]))
    why = "held out: no fit sees it"
    return (
        DeviceExperiment("sweep", op, why, frequencies=between),
        DeviceExperiment("event", op, why, event),
        DeviceExperiment("event", op, why, step),
    )


def _key(ranked: Ranked) -> tuple[str, str, str]:
    op = ranked.op
    text = f"p={op.p:g},q={op.q:g}" + ("" if op.v == 1 else f",v={op.v:g}")
    return "event" if ranked.event else "sweep", text, ranked.event


def _why(best: Ranked, blind: Collection[tuple[str, str]]) -> str:
    """The reason for an experiment, a sentence. blind : pairs that nothing tells apart."""
    pairs = [pair for pair in best.separates if tuple(pair[:2]) not in blind]
    if pairs and best.decides(blind) > 0:
        first, second, bits = min(pairs, key=lambda pair: pair[2])
        verb = "decides between" if bits >= DECISIVE else "says most about"
        return f"it {verb} {short_name(first)} and {short_name(second)}: {bits:.3g} bits expected"
    name, ratio = min(best.gain.items(), key=lambda item: item[1], default=("", 1.0))
    return (
        f"it tells most of the parameters: {best.information:.3g} bits; the deviation of {name} "
        f"falls to {100 * ratio:.2g} %"
    )
