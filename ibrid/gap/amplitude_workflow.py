"""The gap workflow on sweeps at several injection amplitudes: gate, nonlinearity, and the small-signal answer beside it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ibrid.gap.amplitude_answer import believed_of, effect_of, sentence_of, steps_of, weighed
from ibrid.gap.amplitude_result import FEWEST, AmplitudeAnswer, at_every_amplitude, nrmse_at_all
from ibrid.gap.answer import answer_of
from ibrid.gap.convention import Convention
from ibrid.gap.noise import Noise, noise_of
from ibrid.gap.nonlinear_data import AmplitudeData, amplitude_data
from ibrid.gap.nonlinear_naming import Naming, name_nonlinearity
from ibrid.gap.nonlinear_places import places
from ibrid.gap.port_map import PortFit, port_map
from ibrid.gap.prior import Nominal, Prior
from ibrid.gap.refit import Refitter
from ibrid.gap.result import Gap, Verdict
from ibrid.gap.trial import Model, Workshop
from ibrid.gap.verdict import Findings
from ibrid.measurement.amplitudes import at_amplitudes
from ibrid.measurement.linearity import Linearity, small_signal
from ibrid.measurement.sweep import Sweep
from ibrid.parts.catalogue import CATALOGUE
from ibrid.structure.diagram import Diagram
from ibrid.study import Study
from ibrid.telling import Count

#: Verdicts that a band which no amplitude touches may still have.
STANDING = ("named", "data-convention")
NEXT = "sweep with smaller amplitudes, and with two more between these"


@dataclass(frozen=True, eq=False)
class GapRequest:
    """What is asked: the model, all data, what is believed. `find` : the small-signal workflow on a sweep with one
    amplitude."""

    diagram: Diagram
    study: Study
    values: Nominal | None
    prior: Prior
    find: Callable[[Sweep], Gap]
    tell: Count


def gap_at_amplitudes(asked: GapRequest, found: Linearity) -> Gap:
    """The answer where there are several amplitudes.

    Where the response depends on the amplitude by more than products of signals cause, a nonlinearity is looked for in all
    amplitudes together, and the small-signal workflow sees the other frequencies alone. found : of the fitted points.
    """
    small = small_signal(asked.study.sweep, found)
    kept = 0 if small is None else min(len(point.frequency) for point in small.points)
    answer = AmplitudeAnswer(found, kept)
    if not len(found.refused) and small is not None:
        gap = asked.find(small)
        return replace(gap, sentence=f"{gap.sentence} {found.sentence}", amplitude=answer)
    data = amplitude_data(asked.study.fitted)
    naming = None if data is None else _named(asked, asked.diagram, data)
    if naming is not None and data is not None and naming.named:
        return _answered(asked, small if small is not None and kept >= FEWEST else None, naming, data, answer)
    if small is None or kept < FEWEST:
        gap = _linear_gap(
            asked, at_amplitudes(asked.study.sweep)[0], asked.diagram, {} if naming is None else naming.linear.values
        )
    else:
        gap = asked.find(small)
        if gap.verdict == "named" and data is not None:
            again = _named(asked, gap.diagram, data)
            if again is not None and again.named:
                return _answered_beside(gap, again, data, answer)
    return _unnamed(asked, gap, naming, data, answer)


def _named(asked: GapRequest, diagram: Diagram, data: AmplitudeData) -> Naming | None:
    rng = np.random.default_rng(asked.study.seed)
    return name_nonlinearity(diagram, asked.study.kinds, data, asked.prior, rng, asked.tell)


# --- named -----------------------------------------------------------------------------------------------------------


def _answered(
    asked: GapRequest, small: Sweep | None, naming: Naming, data: AmplitudeData, answer: AmplitudeAnswer
) -> Gap:
    """A nonlinearity alone: the linear model at the values that all amplitudes tell."""
    fit = believed_of(naming)
    sweep = at_amplitudes(asked.study.sweep)[0] if small is None else small
    gap = _linear_gap(asked, sweep, asked.diagram, fit.values)
    answer = weighed(answer, naming, data)
    return replace(
        gap,
        verdict="named",
        sentence=f"{sentence_of(naming, answer)} {answer.linearity.sentence}",
        ports=(),
        effects=(effect_of(naming),),
        before={**gap.before, "nominal": _as_given(asked, data), "refit": answer.before},
        after={**gap.after, "refit": answer.after},
        noise_floor=answer.floor,
        steps=(*steps_of(naming, answer), *gap.steps),
        amplitude=answer,
    )


def _as_given(asked: GapRequest, data: AmplitudeData) -> float | None:
    """Error of the linear model at nominal values over all amplitudes; None where no values were given."""
    if not asked.values:
        return None
    refitter = Refitter(
        Noise(data.pooled, True, ""), asked.study.kinds, asked.prior, np.random.default_rng(asked.study.seed)
    )
    return nrmse_at_all(data, at_every_amplitude(refitter.at_values(asked.diagram, {}).responses, data))


def _answered_beside(gap: Gap, naming: Naming, data: AmplitudeData, answer: AmplitudeAnswer) -> Gap:
    """A nonlinearity beside what the small-signal workflow named."""
    answer = weighed(answer, naming, data)
    return replace(
        gap,
        sentence=f"{gap.sentence} {sentence_of(naming, answer)} {answer.linearity.sentence}",
        effects=(*gap.effects, effect_of(naming)),
        steps=(*gap.steps, *steps_of(naming, answer)),
        amplitude=answer,
    )


# --- not named -------------------------------------------------------------------------------------------------------


def _unnamed(
    asked: GapRequest, gap: Gap, naming: Naming | None, data: AmplitudeData | None, answer: AmplitudeAnswer
) -> Gap:
    """No nonlinearity with a name: what the other frequencies say, and where the dependence sits."""
    words = [answer.linearity.sentence]
    steps = gap.steps
    if naming is not None and data is not None:
        answer = weighed(answer, naming, data)
        steps = (*steps_of(naming, answer), *steps)
    verdict: Verdict = gap.verdict
    ports: tuple[PortFit, ...] = gap.ports
    if naming is not None and naming.best is not None:
        verdict = "located-unnamed"
        found = " or ".join(one.place.words for one in (naming.best, *naming.alike))
        words += [f"{found[0].upper()}{found[1:]} explains it, which is no effect of the catalogue."]
    elif verdict not in STANDING:
        ports = () if data is None else _ports_at_all(asked, data)
        places_ = ", ".join(one.port.words for one in ports if one.adequate)
        verdict = "located-unnamed" if places_ else "unexplained"
        words += [
            f"Neither a current limit nor a dead zone explains it; it acts at {places_}."
            if places_
            else "Neither a current limit nor a dead zone explains it, and no single place does."
        ]
    words += [f"Next: {NEXT}."]
    sentence = " ".join(words if verdict not in STANDING else [gap.sentence, *words])
    effects = gap.effects if verdict in STANDING else ()
    return replace(gap, verdict=verdict, sentence=sentence, effects=effects, ports=ports, steps=steps, amplitude=answer)


def _ports_at_all(asked: GapRequest, data: AmplitudeData) -> tuple[PortFit, ...]:
    """Ports of nonlinearities at which one unknown transfer explains each amplitude by itself; the worst amplitude's fit."""
    names = list(dict.fromkeys(one.port.name for one in places(asked.diagram, asked.study.kinds)))
    if not names:
        return ()
    by_level = []
    for level in range(data.amplitude.shape[2]):
        if not (data.weight[:, :, level] > 0).all():
            continue
        asked.tell(level, data.amplitude.shape[2], "the port map of an amplitude")
        points = tuple(
            replace(
                point, admittance=data.admittance[:, m, level], sigma=1.0 / data.weight[:, m, level], amplitude=None
            )
            for m, point in enumerate(data.sweep.points)
        )
        sweep = replace(data.sweep, points=points)
        by_level.append(
            {
                one.port.name: one
                for one in port_map(asked.diagram, asked.study.kinds, sweep, asked.prior, [{}], only=names)
            }
        )
    found = [
        max((level[name] for level in by_level), key=lambda one: one.chi2_per_dof)
        for name in names
        if all(name in level for level in by_level)
    ]
    return tuple(sorted(found, key=lambda one: one.chi2_per_dof))


def _linear_gap(asked: GapRequest, sweep: Sweep, diagram: Diagram, values: Mapping[str, float]) -> Gap:
    """The linear model at given values as an answer that names nothing."""
    fitted = sweep.without(asked.study.held) if asked.study.held else sweep
    noise = noise_of(fitted)
    shop = Workshop(noise, asked.study.kinds, asked.prior, CATALOGUE, np.random.default_rng(asked.study.seed))
    given = Model(diagram, Convention(), shop.refitter(Convention()).at_values(diagram, values))
    found = Findings(noise, given, given, (), (), (), 1.0, 0, ())
    return answer_of(found, shop, diagram, sweep, asked.study.held, asked.values, ())
