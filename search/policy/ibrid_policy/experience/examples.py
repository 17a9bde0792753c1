"""Examples of repairs: damaged parents of one inverter, each fitted, with the edits that undo the
damage.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY, Vocabulary
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text
from ibrid_policy.experience.barred import BARRED
from ibrid_policy.experience.choices import Choices, in_the_paper
from ibrid_policy.experience.damage import legal, merged, spoiled, taken_apart
from ibrid_policy.experience.drawn_diagram import drawn_diagram
from ibrid_policy.experience.inverter import Inverter, draw_inverter, drawn_choices
from ibrid_policy.residual import ResidualMeans, residual_of

#: Effort of a fit: the true values are tried beside the starts, so few starts do.
BRIEF = FitSettings(
    starts=24,
    kept=2,
    kept_misfit=2,
    halving=((6, 2),),
    restarts=0,
    hops=0,
    warm=4,
    warm_kept=1,
    iterations=30,
    ipopt_iterations=10,
)
#: Errors below this count as this: nothing is gained by repairing what fits already.
LEAST_ERROR = 1e-4
#: How often a damaged parent gets a slip on top.
SLIPS = 0.35


@dataclass(frozen=True)
class Setting:
    """Words a program may use, and how it is fitted."""

    name: str
    kinds: Vocabulary
    equilibrium: str
    parameters: str


SETTINGS = (
    Setting("paper", PAPER_VOCABULARY, "paper", "per-op"),
    Setting("extended", VOCABULARY, "exact", "shared"),
)


@dataclass(frozen=True, eq=False)
class Example:
    """A damaged parent and its repair.

    `what` : "part" (one part), "parts" (two), "slip" (a slip undone), "beside" (a part, with a slip
    left as it is).
    `gain` : ln(NRMSE of the parent / of the child); None where the child was not fitted. `error` :
    NRMSE of the parent.
    """

    parent: str
    child: str
    residual: ResidualMeans
    setting: str
    what: str
    gain: float | None
    error: float
    inverter: int
    family: str

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {**vars(self), "residual": self.residual.to_json()}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Example":
        """Back from plain data."""
        return cls(**{**data, "residual": ResidualMeans.from_json(data["residual"])})


def held_out_family(choices: Choices) -> str:
    """The family that is kept for the measurement and never trained on; "" for all others."""
    if choices.get("frame") in ("hybrid", "oscillator"):
        return choices["frame"]
    if choices.get("p") == "dc link" and choices.get("q") == "magnitude":
        return "dc link with voltage control"
    return ""


def draw_examples(
    seed: int, number: int, *, families: Sequence[str] | None = None
) -> Iterator[Example]:
    """The examples of inverter `number`: the same for the same seed and number.

    families : draw until the inverter is of one of these held-out families; None: of none of them.
    """
    rng = np.random.default_rng([seed, number, 0 if families is None else 1])
    setting = SETTINGS[int(rng.random() < 0.5)]
    inverter = None
    while inverter is None:
        choices = drawn_choices(rng)
        family = held_out_family(choices)
        if family not in ([""] if families is None else families):
            continue
        if setting.name == "paper" and families is not None:
            setting = SETTINGS[
                1
            ]  # of the held-out families hardly anything is left in the paper's vocabulary
        inverter = draw_inverter(rng, choices)
    yield from _of(rng, inverter, setting, number, family)


def _of(
    rng: np.random.Generator, inverter: Inverter, setting: Setting, number: int, family: str
) -> Iterator[Example]:
    paper = setting.name == "paper"
    whole = in_the_paper(inverter.choices) if paper else dict(inverter.choices)
    known = _known_values(inverter, setting)

    def barred(diagram: Diagram) -> bool:
        return structure_hash(diagram, setting.kinds, equilibrium=setting.equilibrium) in BARRED

    def example(parent: "_Fitted", child: Diagram, what: str, gain: float | None) -> Example:
        return Example(
            program_text(parent.diagram),
            program_text(child),
            parent.residual,
            setting.name,
            what,
            gain,
            parent.error,
            number,
            family,
        )

    chain: list[_Fitted] = []
    for choices in taken_apart(rng, whole, paper=paper):
        diagram = drawn_diagram(choices, setting.kinds)
        fitted = _fit(diagram, inverter.sweep, setting, known)
        if fitted is None or barred(diagram):
            chain = []  # neighbours on both sides of it are no neighbours
            continue
        for back, what in ((1, "part"), (2, "parts")):
            if len(chain) >= back and chain[-back].error < fitted.error * 1.02:
                yield example(fitted, chain[-back].diagram, what, fitted.gain_of(chain[-back]))
        if chain and rng.random() < SLIPS:
            slip = spoiled(rng, diagram, setting.kinds, setting.equilibrium)
            worse = (
                None if slip is None or barred(slip) else _fit(slip, inverter.sweep, setting, known)
            )
            if worse is not None and worse.error > 0.98 * fitted.error:
                yield example(worse, diagram, "slip", worse.gain_of(fitted))
                both = merged(diagram, worse.diagram, chain[-1].diagram)
                better = fitted.gain_of(chain[-1]) > 0.05
                if (
                    both is not None
                    and better
                    and legal(both, setting.kinds, setting.equilibrium)
                    and not barred(both)
                ):
                    yield example(worse, both, "beside", None)
        chain.append(fitted)


@dataclass(frozen=True, eq=False)
class _Fitted:
    diagram: Diagram
    error: float
    residual: ResidualMeans

    def gain_of(self, other: "_Fitted") -> float:
        return log(max(self.error, LEAST_ERROR) / max(other.error, LEAST_ERROR))


def _fit(
    diagram: Diagram, sweep: Sweep, setting: Setting, known: Mapping[str, Mapping[str, float]]
) -> _Fitted | None:
    """A brief fit; None where it fails."""
    record: Record = evaluate(
        diagram,
        sweep,
        parameters=setting.parameters,
        equilibrium=setting.equilibrium,
        vocabulary=setting.kinds,
        settings=BRIEF,
        warm=known,
    )
    if record.outcome != Outcome.OK or record.nrmse is None:
        return None
    try:
        return _Fitted(
            diagram, record.nrmse, residual_of(replace(record, vocabulary=VOCABULARY), sweep)
        )
    except IbridError:
        return None


def _known_values(inverter: Inverter, setting: Setting) -> dict[str, Mapping[str, float]]:
    """The true values under the names of the setting, to begin every fit from."""
    values = dict(inverter.values)
    if setting.name == "paper":
        seconds = {"decoupling": "measured", "voltage decoupling": "measured"}
        for part, name in (
            ("decoupling", "decoupling.L"),
            ("voltage decoupling", "e_decoupling.L"),
        ):
            if inverter.choices.get(part) == seconds[part] and name in values:
                values[name] /= inverter.sweep.omega_0
    return {point.op.name: values for point in inverter.sweep.points}
