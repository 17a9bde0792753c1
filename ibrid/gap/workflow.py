"""find_gap(model, sweep): refit, locate, name, repair, verify; and refuse where the data do not carry an answer."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, Unpack

from ibrid.errors import IbridError
from ibrid.fit import kernel
from ibrid.gap.amplitude_answer import Nonlinear, alone, beside, unnamed
from ibrid.gap.amplitudes import Amplitudes
from ibrid.gap.answer import answer_of
from ibrid.gap.convention import Convention
from ibrid.gap.data import Data, Values
from ibrid.gap.held_out import predicts
from ibrid.gap.noise import Noise, noise_of
from ibrid.gap.nonlinear_data import AmplitudeData, amplitude_data
from ibrid.gap.port_map import PortFit
from ibrid.gap.prior import Nominal, Prior, prior_of
from ibrid.gap.repair import Bench, first_trials, repair
from ibrid.gap.result import AmplitudeAnswer, Gap
from ibrid.gap.suggesting import Suggest, low_order_blocks
from ibrid.gap.trial import Model, Workshop
from ibrid.gap.verdict import Findings, fits, scale_of
from ibrid.measurement.amplitudes import at_amplitudes
from ibrid.measurement.linearity import Linearity, linearity, small_signal
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
#: Fewest frequencies of every operating point from which a small-signal answer can be had beside several amplitudes.
FEWEST = 4
Kind = TypeVar("Kind", bound=Data)


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
    kernel.load()
    began = time.perf_counter()
    require_legal(diagram, study.kinds, equilibrium="exact")
    wiring = wire(diagram, study.kinds)
    prior = prior_of(values or {}, wiring, parameter_table(wiring, "exact"))
    gate = linearity(study.fitted)
    with telling(progress) as tell:
        ask = _Question(diagram, study, values, prior, tuple(catalogue), suggest, in_pieces(tell))
        gap = _answered(ask) if gate is None else _answered_at_amplitudes(ask, gate)
    return replace(gap, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class _Question:
    """What is asked of a study."""

    diagram: Diagram
    study: Study
    values: Nominal | None
    prior: Prior
    catalogue: tuple[Effect, ...]
    suggest: Sequence[Suggest]
    tell: Count

    def workshop(self, noise: Noise) -> Workshop:
        """The small-signal sweep at a noise."""
        return Workshop(noise, self.study.kinds, self.prior, self.catalogue, self.study.seed)

    def amplitudes(self, data: AmplitudeData) -> Amplitudes:
        """All amplitudes."""
        return Amplitudes(data, self.study.kinds, self.prior, self.study.seed)


def _answered(ask: _Question) -> Gap:
    """The answer where there is one amplitude."""
    result = _findings(ask, ask.diagram, ask.workshop, noise_of(ask.study.fitted))
    if result is None:
        raise IbridError("the model has no response at these operating points; check p, q, v and the per-unit base")
    found, shop = result
    return answer_of(found, shop, ask.diagram, ask.study.sweep, ask.study.held, ask.values, ask.suggest)


# --- several amplitudes ----------------------------------------------------------------------------------------------


def _answered_at_amplitudes(ask: _Question, gate: Linearity) -> Gap:
    """The answer where there are several amplitudes; gate : of the fitted points.

    Where the response depends on the amplitude by more than products of signals cause, a nonlinearity is looked for in all
    amplitudes together, and the small-signal sweep has the other frequencies alone.
    """
    sweep, small = ask.study.sweep, small_signal(ask.study.sweep, gate)
    answer = AmplitudeAnswer(gate, 0 if small is None else min(len(point.frequency) for point in small.points))
    if not len(gate.refused) and small is not None:
        gap = _answered(replace(ask, study=replace(ask.study, sweep=small)))
        return replace(gap, sentence=f"{gap.sentence} {gate.sentence}", amplitude=answer)
    small = small if answer.kept >= FEWEST else None
    data = amplitude_data(ask.study.fitted)
    nonlinear = None if data is None else _nonlinear(ask, ask.diagram, data, answer)
    if nonlinear is not None and nonlinear.best is not None and nonlinear.named:
        gap = _linear(ask, at_amplitudes(sweep)[0] if small is None else small, nonlinear.best.values)
        return alone(gap, nonlinear, _nominal(ask, nonlinear) if ask.values else None)
    if small is None:
        gap = _linear(ask, at_amplitudes(sweep)[0], {} if nonlinear is None else nonlinear.found.given.refit.values)
        return unnamed(gap, nonlinear, answer)
    gap = _answered(replace(ask, study=replace(ask.study, sweep=small)))
    if gap.verdict == "named" and data is not None:
        again = _nonlinear(ask, gap.diagram, data, answer)
        if again is not None and again.named:
            return beside(gap, again)
    return unnamed(gap, nonlinear, answer)


def _nonlinear(ask: _Question, diagram: Diagram, data: AmplitudeData, gate: AmplitudeAnswer) -> Nonlinear | None:
    """What all amplitudes together tell beside a linear model; None where that has no response."""
    result = _findings(ask, diagram, lambda _: ask.amplitudes(data), Noise(data.pooled, True, ""))
    return None if result is None else Nonlinear(*result, gate)


def _linear(ask: _Question, sweep: Sweep, values: Values) -> Gap:
    """The linear model at given values as an answer that names nothing."""
    fitted = sweep.without(ask.study.held) if ask.study.held else sweep
    shop = replace(ask, catalogue=CATALOGUE).workshop(noise_of(fitted))
    given = Model(ask.diagram, Convention(), shop.refitter(Convention()).at_values(ask.diagram, values))
    found = Findings(shop.noise, given, given, (), (), (), 1.0, 0, ())
    return answer_of(found, shop, ask.diagram, sweep, ask.study.held, ask.values, ())


def _nominal(ask: _Question, nonlinear: Nonlinear) -> float:
    """Error of the linear model at nominal values over all amplitudes."""
    data = nonlinear.data
    return data.data.linear_nrmse(data.refitter.at_values(ask.diagram, {}).responses)


# --- any kind of data ------------------------------------------------------------------------------------------------


def _findings(
    ask: _Question, diagram: Diagram, data_at: Callable[[Noise], Kind], noise: Noise
) -> tuple[Findings, Kind] | None:
    """Everything tried; again with what is left over as the noise, where that is not known and not what was assumed.

    A sigma that is too small lets the data pull parameters where no prior would have them, along directions that the
    data hardly see; whatever stops that seems to be missing. None where the given model has no response.
    """
    data = data_at(noise)
    found = _tried(ask, diagram, data, ())
    for _ in range(PASSES - 1):
        if found is None or not found.weighed_wrongly:
            break
        noise = found.noise.times(found.scale)
        data = data_at(noise)
        found = _tried(ask, diagram, data, (f"the noise is not known: begun again with {noise.level:.2g} of |Y|",))
    return None if found is None else (found, data)


def _tried(ask: _Question, diagram: Diagram, data: Data, steps: Sequence[str]) -> Findings | None:
    noise = data.noise
    ask.tell(0, 1, "the given model refitted")
    given = data.given(diagram)
    if given is None:
        return None
    bench = Bench(data, ask.tell, list(steps))
    bench.steps.append(f"refitted the given model: chi2 {given.refit.chi2:.4g} of {given.refit.numbers} numbers")
    given, trials = first_trials(bench, given)
    bench.scale, ports = scale_of(noise, [given, *trials], ()), ()
    if not (noise.known or any(fits(one, noise, bench.scale) for one in [given, *trials])):
        ports = _ports(ask, data, bench, given)  # a single place may tell how large the noise is
        bench.scale = scale_of(noise, [given, *trials], ports)
    trials.sort(key=lambda one: one.bic(bench.scale))
    best, rivals = repair(bench, given, trials)
    before, after = (data.held_out(given), data.held_out(best)) if best is not given else (None, None)
    if before is not None and after is not None and not predicts(before, after, len(noise.sweep.points)):
        bench.steps.append(
            "the repair predicts data that it was not fitted to worse than the given model; it is dropped"
        )
        best, after, rivals = given, None, []
    if not ports:
        ports = _ports(ask, data, bench, given, best if fits(best, noise, bench.scale) else None)
    bench.scale = scale_of(noise, [given, best, *trials], ports)
    return Findings(
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


def _ports(
    ask: _Question, data: Data, bench: Bench, given: Model, repaired: Model | None = None
) -> tuple[PortFit, ...]:
    """The port map of a model that is not adequate."""
    if given.adequate():
        return ()
    ask.tell(0, 1, "the port map")
    return data.ports(given, bench.steps, repaired)
