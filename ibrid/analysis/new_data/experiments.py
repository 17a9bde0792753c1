"""What to measure next: sweeps and events ranked by what they would tell of parameters, and of
structures left open.

A sweep of frequencies F at an operating point is n = 8 |F| real numbers with Gaussian errors of
deviation s. To first order in the parameters x, with J = dY/dx / s whitened and C their covariance
so far (Laplace),

    C' = (C^-1 + J'J)^-1,    sd ratio of a parameter = sqrt(C'_jj / C_jj),
    information = 1/2 log2 det(1 + J C J') bits,

and with a rival that answers r = (Y_rival - Y) / s differently, where the parameters of both may
still move,

    bits = 1 / (2 ln 2) r' (1 + J C J' + J_r C_r J_r')^-1 r,

what is left of the difference beside the predictive spread of both (Box and Hill, Discrimination
among mechanistic models, 1967; Fedorov, Theory of optimal experiments, 1972). Fits of few data are
less linear than their covariance says, so both are given `CAUTION` times their deviation.
Frequencies are taken one by one, each where it adds most. A record of an event is the same with the
samples of the nonlinear model (`ibrid.analysis.new_data.event_answers`).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from ibrid.analysis.models.linear_model import linear_model, whole_record, with_point
from ibrid.analysis.models.parametric import ParametricModel, Uncertainty, uncertainty
from ibrid.analysis.models.prediction import sizes
from ibrid.analysis.new_data.event_answers import Structure, event_answers
from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.writing import PlainData

#: Bits that a pair of structures must be apart to count as told apart: odds of 20 to 1.
DECISIVE = float(np.log2(20.0))
#: Bits between structures up to which an experiment tells nothing of them.
SLIGHT = 0.05
#: A ratio of standard deviations above which a parameter has gained nothing.
NOTHING = 0.98
#: Factor on the deviations of parameters when structures are compared.
CAUTION = 2.0
#: Relative noise of a measurement to come where the record knows none.
ASSUMED_NOISE = 0.01


@dataclass(frozen=True)
class Among:
    """What the user can do: operating points `p`, `q`, `v` (per unit, all combinations), `count`
    frequencies of those between `low` and `high` (Hz; None: the range of the record), with relative
    noise `noise` (None: that of the record); `events` at the same points, written as `ibrid record`
    takes them, with the noise `record_noise` of each sample, relative to the rms of what happens.
    `parameters` : names of the answer's that are asked for, all of them when none is named.
    """

    p: tuple[float, ...] = (0.0, 0.5, 1.0)
    q: tuple[float, ...] = (-0.3, 0.0, 0.3)
    v: tuple[float, ...] = (1.0,)
    count: int = 16
    low: float | None = None
    high: float | None = None
    noise: float | None = None
    events: tuple[str, ...] = ("dip:0.7", "phase:20")
    record_noise: float = 0.01
    parameters: tuple[str, ...] = ()
    of: int = 48

    def points(self) -> tuple[OperatingPoint, ...]:
        """All operating points."""
        return tuple(
            OperatingPoint(f"p={p:g},q={q:g}" + (f",v={v:g}" if v != 1 else ""), p, q, v)
            for p, q, v in product(self.p, self.q, self.v)
        )


@dataclass(frozen=True)
class Experiment(Frozen):
    """A sweep of `frequencies`, or a record of an `event`. `gain` : parameter -> standard deviation
    after it over that before.
    `information` : bits on the parameters. `separates` : (structure, structure, bits).
    """

    op: OperatingPoint
    frequencies: tuple[float, ...]
    gain: dict[str, float]
    information: float
    separates: tuple[tuple[str, str, float], ...]
    event: str = ""

    def decides(self, without: Collection[tuple[str, str]] = ()) -> float:
        """Bits between the two structures that it tells apart least, slight ones as 0, some pairs
        left out; infinite without.
        """
        least = min(
            (bits for *pair, bits in self.separates if tuple(pair) not in without),
            default=float("inf"),
        )
        return least if least >= SLIGHT else 0.0

    def plain(self) -> PlainData:
        """For JSON."""
        what = {"event": self.event} if self.event else {"frequencies": list(self.frequencies)}
        return {
            "kind": "event" if self.event else "sweep",
            **what,
            "op": {"name": self.op.name, "p": self.op.p, "q": self.op.q, "v": self.op.v},
            "gain": self.gain,
            "information": self.information,
            "separates": [list(pair) for pair in self.separates],
        }


@dataclass(frozen=True)
class _Known:
    """A structure with its parameters at one operating point: whitened answer (K, 8), and its
    slopes along R directions of standard deviation one, (K, 8, R). `sure`, `names` : of the
    parameters.
    """

    name: str
    answer: np.ndarray
    slopes: np.ndarray
    sure: Uncertainty


def experiments(
    records: Sequence[Record], names: Sequence[str], among: Among
) -> tuple[Experiment, ...]:
    """Sweeps and events at all operating points of `among` at which every record has an answer, the
    most telling first.

    records : the answer, then its rivals; `names` : what each structure is called (its hash). Where
    parameters are named the one that leaves their deviations smallest comes first; else with rivals
    the one that leaves the least doubt between them, without any, or where it is told nothing of
    them, the one with most information on the answer's parameters.

    Raises IbridError where the answer cannot predict or lacks a parameter, or no operating point
    can be asked.
    """
    answer = records[0]
    free = answer.covariance.get("names", ())
    for name in among.parameters:
        if name not in free:
            raise IbridError(f"the answer has no free parameter {name!r}; {near(name, free)}")
    frequency = _frequencies(answer, among)
    noise = among.noise or _noise(answer)
    asked, why = list[Experiment](), "none was asked"
    for op in among.points():
        for event in ("", *among.events):
            try:
                with whole_record():
                    structures = [_structure(record, op) for record in records]
                    if event:
                        known = _recorded(structures, names, event, among.record_noise)
                        asked.append(_told(known, op, np.arange(len(known[0].answer)), event=event))
                    else:
                        known = _swept(structures, names, op, frequency, noise)
                        asked.append(_told(known, op, _chosen(known, among), frequency))
            except IbridError as error:
                why = str(error)
    if not asked:
        raise IbridError(f"no operating point can be asked ({why}); give others with --among FILE")
    if among.parameters:
        return tuple(
            sorted(asked, key=lambda one: np.prod([one.gain[name] for name in among.parameters]))
        )
    blind = hopeless(asked)
    return tuple(
        sorted(asked, key=lambda one: (-min(one.decides(blind), DECISIVE * 8), -one.information))
    )


def with_twins(
    names: Sequence[str], records: Sequence[Record]
) -> tuple[tuple[str, ...], tuple[Record, ...]]:
    """The structures, and beside them the other values of the answer's that fit as well, named
    "twin 1 of HASH" and so on.

    A twin is given the covariance of the answer, which holds relative deviations.
    """
    answer = records[0]
    twins = [
        replace(
            answer, parameters={op: {**values, **twin} for op, values in answer.parameters.items()}
        )
        for twin in answer.twins
    ]
    told = [f"twin {number} of {names[0]}" for number in range(1, len(twins) + 1)]
    return (*names, *told), (*records, *twins)


def sentences(asked: Sequence[Experiment], among: Among) -> tuple[str, ...]:
    """What no experiment can tell: structures that stay within odds of 20 to 1 everywhere, and
    parameters that gain nothing; and events in which a model has no answer anywhere.
    """
    said = [
        f"nothing you can do at the terminals will tell {short_name(one)} from "
        f"{short_name(other)}, of all that was asked: "
        f"at most {bits:.1g} bits; a record of an event that reaches a limit may"
        for (one, other), bits in _most_bits(asked).items()
        if bits < DECISIVE
    ]
    if lost := [event for event in among.events if all(one.event != event for one in asked)]:
        said.append(
            f"{', '.join(lost)} could not be asked: a model leaves or has no answer at every "
            "operating point"
        )
    blind = [name for name in asked[0].gain if min(one.gain[name] for one in asked) > NOTHING]
    if len(blind) == len(asked[0].gain):
        said.append("nothing that was asked tells more of the parameters than is known")
    elif blind:
        said.append(f"nothing that was asked tells more of {', '.join(blind)}")
    return tuple(said)


def short_name(name: str) -> str:
    """A hash by its first eight digits, also that of a twin."""
    *words, code = name.split(" ")
    return " ".join((*words, code[:8]))


def _most_bits(asked: Sequence[Experiment]) -> dict[tuple[str, str], float]:
    """Pair of structures -> bits by which the best experiment tells them apart."""
    most: dict[tuple[str, str], float] = {}
    for one, other, bits in (pair for told in asked for pair in told.separates):
        most[one, other] = max(bits, most.get((one, other), 0.0))
    return most


def hopeless(asked: Sequence[Experiment]) -> set[tuple[str, str]]:
    """Pairs that nothing tells apart, which must not hide what tells others; none where all are
    so.
    """
    bits = _most_bits(asked)
    apart = {pair for pair, most in bits.items() if most < DECISIVE}
    return apart if len(apart) < len(bits) else set()


def _frequencies(record: Record, among: Among) -> np.ndarray:
    low, high = (float(hz) for hz in record.settings["frequency_hz"])
    low, high = among.low or low, among.high or high
    if not 0 < low < high:
        raise IbridError(f"frequencies are asked from low to high, found {low:g} to {high:g} Hz")
    return np.array(
        [float(f"{hz:.4g}") for hz in np.geomspace(low, high, max(among.of, among.count))]
    )


def _noise(record: Record) -> float:
    """Relative to |Y|: the noise floor that the record was judged by, where it was known."""
    floor = (record.misfit or {}).get("floor", {})
    known = floor.get("from") not in (None, "unknown") and floor.get("value")
    return float(floor["value"]) if known else ASSUMED_NOISE


def _structure(record: Record, op: OperatingPoint) -> Structure:
    """Raises IbridError where a record has no operating point, or is unstable on an ideal grid
    there.
    """
    whole, point = with_point(record, f"p={op.p!r},q={op.q!r},v={op.v!r}")
    linear = linear_model(whole, point)
    if np.linalg.eigvals(linear.A).real.max(initial=-1.0) > 1e-6:
        raise IbridError(f"the model is unstable at {op.name}")
    model = ParametricModel(whole, OperatingPoint(point, linear.p, linear.q, linear.v))
    sure = uncertainty(whole, model)
    if sure is None:
        raise IbridError("the record holds no covariance; fit again with --parameters shared")
    return whole, linear, model, sure


def _swept(
    structures: Sequence[Structure],
    names: Sequence[str],
    op: OperatingPoint,
    frequency: np.ndarray,
    noise: float,
) -> list[_Known]:
    """Structures in a sweep, all whitened by the noise of the first one's answer.

    IbridError where one has no answer.
    """
    known, deviation = [], np.zeros(0)
    for (_, _, model, sure), name in zip(structures, names, strict=True):
        response, slopes = model.admittance(frequency), model.slopes(frequency) @ sure.directions
        if not (np.isfinite(response).all() and np.isfinite(slopes).all()):
            raise IbridError(f"the model has no finite answer at {op.name}")
        if not known:
            deviation = noise * sizes(response) / np.sqrt(8.0)
        answer = _real(response.reshape(len(frequency), 4, 1))[..., 0] / deviation[:, None]
        slopes = _real(slopes.reshape(len(frequency), 4, -1)) / deviation[:, None, None]
        known.append(_Known(name, answer, slopes, sure))
    return known


def _recorded(
    structures: Sequence[Structure], names: Sequence[str], event: str, noise: float
) -> list[_Known]:
    """The same in a record, whose numbers go together by eight as those of a frequency do."""
    known = []
    for (answer, slopes), name, (*_, sure) in zip(
        event_answers(structures, event, noise), names, structures, strict=True
    ):
        rest = -len(answer) % 8
        rows = np.pad(slopes, ((0, rest), (0, 0))).reshape(-1, 8, slopes.shape[1])
        known.append(_Known(name, np.pad(answer, (0, rest)).reshape(-1, 8), rows, sure))
    return known


def _real(values: np.ndarray) -> np.ndarray:
    """(K, 4, R) complex as (K, 8, R)."""
    return np.concatenate([np.real(values), np.imag(values)], axis=1)


def _chosen(known: Sequence[_Known], among: Among) -> np.ndarray:
    """The frequencies that tell most."""
    every = np.arange(len(known[0].answer))
    apart = (
        []
        if among.parameters
        else [(_apart(*pair, every), pair) for pair in combinations(known, 2)]
    )
    for least in (DECISIVE, SLIGHT):
        if able := [pair for bits, pair in apart if bits >= least]:
            return _for_structures(able, among.count)
    return _for_parameters(known[0], among)


def _told(
    known: Sequence[_Known],
    op: OperatingPoint,
    chosen: np.ndarray,
    frequency: Sequence[float] | np.ndarray = (),
    *,
    event: str = "",
) -> Experiment:
    """What is told by the chosen frequencies, or by the event."""
    answer = known[0]
    flat = answer.slopes[chosen].reshape(-1, answer.slopes.shape[-1])
    after = np.linalg.inv(
        np.eye(flat.shape[1]) + flat.T @ flat
    )  # covariance, where it was one along each direction
    before = (answer.sure.directions**2).sum(axis=1)
    left = np.einsum("pr,rs,ps->p", answer.sure.directions, after, answer.sure.directions)
    gain = np.sqrt(np.divide(left, before, out=np.ones_like(left), where=before > 0))
    information = -0.5 * float(np.linalg.slogdet(after)[1]) / np.log(2.0)
    separates = tuple(
        (one.name, other.name, _apart(one, other, chosen)) for one, other in combinations(known, 2)
    )
    gains = {name: float(ratio) for name, ratio in zip(answer.sure.names, gain, strict=True)}
    if not np.isfinite([information, *gain, *(bits for *_, bits in separates)]).all():
        raise IbridError(
            f"what {event or 'a sweep'} tells at {op.name} is no finite number; is the noise far "
            "too small?"
        )
    asked = () if event else tuple(float(frequency[k]) for k in chosen)
    return Experiment(op, asked, gains, information, separates, event)


def _for_parameters(known: _Known, among: Among) -> np.ndarray:
    """Frequencies, one by one, each with the most information on the parameters (D-optimal), or
    after which the product of the named ones' deviations is smallest.
    """
    chosen: list[int] = []
    covariance = np.eye(known.slopes.shape[-1])
    named = known.sure.directions[[known.sure.names.index(name) for name in among.parameters]]
    for _ in range(among.count):
        inside = np.eye(8) + known.slopes @ covariance @ known.slopes.transpose(0, 2, 1)
        if among.parameters:
            follows = named @ covariance @ known.slopes.transpose(0, 2, 1)  # (K, named, 8)
            gone = (
                follows * np.linalg.solve(inside, follows.transpose(0, 2, 1)).transpose(0, 2, 1)
            ).sum(axis=2)
            variance = np.einsum("pr,rs,ps->p", named, covariance, named)
            worth = -np.log(np.maximum(variance - gone, np.finfo(float).tiny)).sum(axis=1)
        else:
            worth = np.linalg.slogdet(inside)[1]
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        covariance = _updated(covariance, known.slopes[best], inside[best])
    return np.sort(np.array(chosen))


def _updated(covariance: np.ndarray, slopes: np.ndarray, inside: np.ndarray) -> np.ndarray:
    follows = covariance @ slopes.T
    return covariance - follows @ np.linalg.solve(inside, follows.T)


def _for_structures(pairs: Sequence[tuple[_Known, _Known]], count: int) -> np.ndarray:
    """Frequencies, one by one, each adding most to the bits of the pair that is told apart least so
    far.

    Bits add up over frequencies as normalised innovations of a Kalman filter do, in which the
    parameters of both follow.
    """
    follow = [_Following(*pair) for pair in pairs]
    chosen: list[int] = []
    for _ in range(count):
        worth = min(follow, key=lambda one: one.told).worth()
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        for pair in follow:
            pair.take(best)
    return np.sort(np.array(chosen))


class _Following:
    """Two structures that are fitted again and again while frequencies come in; `told` : the chi2
    that is left between them.
    """

    def __init__(self, one: _Known, other: _Known) -> None:
        self.slopes = CAUTION * np.concatenate([one.slopes, other.slopes], axis=2)
        self.difference, self.told = other.answer - one.answer, 0.0
        size = self.slopes.shape[-1]
        self._at, self._covariance = np.zeros(size), np.eye(size)

    def worth(self) -> np.ndarray:
        """(K,) chi2 that each frequency would add."""
        inside = np.eye(8) + self.slopes @ self._covariance @ self.slopes.transpose(0, 2, 1)
        surprise = self.difference + self.slopes @ self._at
        return np.einsum("ki,ki->k", surprise, np.linalg.solve(inside, surprise[..., None])[..., 0])

    def take(self, k: int) -> None:
        """Measure a frequency."""
        slopes = self.slopes[k]
        inside = np.eye(8) + slopes @ self._covariance @ slopes.T
        surprise = self.difference[k] + slopes @ self._at
        solved = np.linalg.solve(inside, surprise)
        self.told += float(surprise @ solved)
        self._at = self._at - self._covariance @ slopes.T @ solved
        self._covariance = _updated(self._covariance, slopes, inside)


def _apart(one: _Known, other: _Known, chosen: np.ndarray) -> float:
    """Bits between two structures after the chosen frequencies."""
    follow = _Following(one, other)
    for k in chosen:
        follow.take(int(k))
    return follow.told / (2.0 * np.log(2.0))
