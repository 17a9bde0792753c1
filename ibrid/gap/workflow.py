"""find_gap(model, sweep): refit, locate, name, repair, verify; and refuse where the data do not carry an answer."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Unpack

import numpy as np

from ibrid.errors import IbridError
from ibrid.fit import kernel
from ibrid.gap.amplitude_workflow import GapRequest, gap_at_amplitudes
from ibrid.gap.answer import answer_of
from ibrid.gap.held_out import held_out, predicts
from ibrid.gap.noise import Noise, noise_of
from ibrid.gap.port_map import PortFit, port_map
from ibrid.gap.prior import Nominal, Prior, prior_of
from ibrid.gap.repair import Bench, first_trials, repair
from ibrid.gap.result import Gap
from ibrid.gap.suggesting import Suggest, low_order_blocks
from ibrid.gap.trial import Model, Workshop
from ibrid.gap.verdict import Findings, scale_of
from ibrid.measurement.linearity import linearity
from ibrid.measurement.sweep import Sweep
from ibrid.parts.catalogue import CATALOGUE
from ibrid.parts.practice import Effect
from ibrid.structure.check import require_legal
from ibrid.structure.diagram import Diagram
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import wire
from ibrid.study import Study, StudyOptions
from ibrid.telling import Count, Tell, in_pieces, telling

#: Times at most that everything is tried, each time with the noise that the time before left over.
PASSES = 3
#: Frequencies that all operating points must share for a port map.
LEAST_SHARED = 6


def find_gap(
    diagram: Diagram,
    sweep: Sweep | Study,
    values: Nominal | None = None,
    *,
    catalogue: Sequence[Effect] = CATALOGUE,
    suggest: Sequence[Suggest] = (low_order_blocks,),
    progress: str | Tell = "silent",
    **options: Unpack[StudyOptions],
) -> Gap:
    """Where a model and a measurement disagree, which physical effect is missing, and the model with it.

    Parameters
    ----------
    diagram : the model that is believed in. sweep : the measured device, or a study of it; with several injection
        amplitudes the response is tested for linearity first, and a current limit or a dead zone is looked for where it
        fails.
    values : nominal values, name -> value or {"value", "tolerance"}; they hold the refit as a prior (one standard
        deviation of the logarithm: 0.25 for the plant, ln 2 for everything else).
    holdout_op, vocabulary, seed : as of `ibrid.study.Study`; held-out points are predicted before and after. A gap is
        sought with shared parameters and the exact equilibrium alone.
    catalogue : effects that may be missing, also `(*CATALOGUE, MINE)`.
    suggest : who is asked for edits where something is located that the catalogue does not know.
    progress : where a line says what is going on: "auto", "terminal", "plain", "notebook", "silent"; or who is told
        (words, share).

    Returns
    -------
    Gap with one of six verdicts: no-gap, parameters-only, named, located-unnamed, unexplained, data-convention.

    Raises
    ------
    IbridError : an illegal model, a name that it lacks, an operating point that the sweep lacks, or no fit at all.
    """
    study = Study.of(sweep, **options)
    if (study.parameters, study.equilibrium) != ("shared", "exact"):
        raise IbridError(
            "a gap is sought with shared parameters and the exact equilibrium; leave the other options out"
        )
    with telling(progress) as tell:
        return _found(diagram, study, values, catalogue, suggest, in_pieces(tell))


def _found(
    diagram: Diagram,
    study: Study,
    values: Nominal | None,
    catalogue: Sequence[Effect],
    suggest: Sequence[Suggest],
    tell: Count,
) -> Gap:
    kernel.load()
    began = time.perf_counter()
    require_legal(diagram, study.kinds, equilibrium="exact")
    wiring = wire(diagram, study.kinds)
    prior = prior_of(values or {}, wiring, parameter_table(wiring, "exact"))
    amplitudes = linearity(study.fitted)
    if amplitudes is not None:

        def find(small: Sweep) -> Gap:
            return _found(diagram, replace(study, sweep=small), values, catalogue, suggest, tell)

        asked = GapRequest(diagram, study, values, prior, find, tell)
        return replace(gap_at_amplitudes(asked, amplitudes), seconds=time.perf_counter() - began)
    ask = _Question(diagram, study, prior, tuple(catalogue), tell)
    found, shop = _findings(ask, noise_of(study.fitted))
    gap = answer_of(found, shop, diagram, study.sweep, study.held, values, suggest)
    return replace(gap, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Question:
    """What is asked of one set of data."""

    diagram: Diagram
    study: Study
    prior: Prior
    catalogue: tuple[Effect, ...]
    tell: Count


def _findings(ask: _Question, noise: Noise) -> tuple[Findings, Workshop]:
    """Everything tried; again with what is left over as the noise, where that is not known and not what was assumed.

    A sigma that is too small lets the data pull parameters where no prior would have them, along directions that the
    data hardly see; whatever stops that seems to be missing.
    """
    found, shop = _tried(ask, noise, ())
    for _ in range(PASSES - 1):
        if not found.weighed_wrongly:
            break
        noise = found.noise.times(found.scale)
        found, shop = _tried(ask, noise, (f"the noise is not known: begun again with {noise.level:.2g} of |Y|",))
    return found, shop


def _tried(ask: _Question, noise: Noise, steps: Sequence[str]) -> tuple[Findings, Workshop]:
    shop = Workshop(noise, ask.study.kinds, ask.prior, ask.catalogue, np.random.default_rng(ask.study.seed))
    ask.tell(0, 1, "the given model refitted")
    given = shop.given(ask.diagram)
    if given is None:
        raise IbridError("the model has no response at these operating points; check p, q, v and the per-unit base")
    bench = Bench(shop, ask.tell, list(steps))
    bench.steps.append(f"refitted the given model: chi2 {given.refit.chi2:.4g} of {given.refit.numbers} numbers")
    given, trials = first_trials(bench, given)
    ports = () if given.adequate() else _ports(ask, given, noise, bench.steps)
    bench.scale = scale_of(noise, [given, *trials], ports)
    trials.sort(key=lambda one: one.bic(bench.scale))
    best, rivals = repair(bench, given, trials)
    before, after = (held_out(shop, given), held_out(shop, best)) if best is not given else (None, None)
    if before is not None and after is not None and not predicts(before, after, len(noise.sweep.points)):
        bench.steps.append(
            "the repair predicts data that it was not fitted to worse than the given model; it is dropped"
        )
        best, after, rivals = given, None, []
    bench.scale = scale_of(noise, [given, best, *trials], ports)
    found = Findings(
        noise,
        given,
        best,
        tuple(map(tuple, rivals)),
        tuple(trials),
        ports,
        bench.scale,
        bench.tests,
        tuple(bench.steps),
        before,
        after,
    )
    return found, shop


def _ports(ask: _Question, given: Model, noise: Noise, steps: list[str]) -> tuple[PortFit, ...]:
    """The port map at the frequencies that all operating points share; empty where there are too few."""
    shared = reduce(np.intersect1d, [point.frequency for point in noise.sweep.points])
    if len(shared) < LEAST_SHARED:
        steps.append(f"no port map: the operating points share {len(shared)} frequencies, it needs {LEAST_SHARED}")
        return ()
    points = tuple(point.at(np.isin(point.frequency, shared)) for point in noise.sweep.points)
    ask.tell(0, 1, "the port map")
    return port_map(
        given.diagram, ask.study.kinds, replace(noise.sweep, points=points), ask.prior, [given.refit.values, {}]
    )
