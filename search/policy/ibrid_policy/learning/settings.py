"""Every number of learning during a search; the defaults are the paper's profile and that of
ThetaEvolve.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from types import MappingProxyType
from typing import Any

from ibrid.errors import IbridError
from ibrid_policy.asking import ANSWERS
from ibrid_policy.learning.advantages import BASELINES, WAYS

#: A model of so many parameters or more is one that others trained on much text.
LARGE = 50_000_000
#: Who says what an answer is worth: the fit of the search, or a first look.
JUDGES = ("fit", "look")
#: What makes a step of the weights from a gradient; see `LearningSettings`.
OPTIMIZERS = ("adam", "sgd")
#: Tokens of a language model's answer that changes one line: two lines of 20 to 30 tokens, and the
#: marks of the block.
LEAST_ANSWER = 90
#: Settings of a language model alone.
OF_LANGUAGE_MODELS = ("constrained", "longest", "question")
#: Adam's step. For a policy of a million parameters 1e-4 changes hardly anything in 32 updates of 8
#: answers, 3e-4 raises the share of answers that gain by a third, 1e-3 goes astray (search/LOG.md,
#: 2026-11-22).
RATE_LARGE, RATE_SMALL, RATE_LORA = 1e-6, 3e-4, 2e-5
#: Step along the gradient itself. For the small policy 0.1 begins to unlearn what it was trained
#: for (search/LOG.md, 2026-11-23).
RATE_SGD = 0.05


@dataclass(frozen=True)
class LearningSettings:
    """How answers are drawn in groups, and what one update does with their rewards.

    `contexts` : questions of a batch. `group` : answers to each. `epochs` : updates from each
    batch. `optimizer` : "adam" as in the paper, or "sgd", a step along the gradient. Adam moves
    every weight as far as any other, however little a small batch says of it, so that a policy
    which is trained after every question forgets. `rate` : of the step; None: by the optimizer and
    the size of the model (`RATE_SMALL`, `RATE_LARGE`, `RATE_LORA`, `RATE_SGD`). `decay1`, `decay2`
    : of Adam's moments.
    `longest_gradient` : norm to which a gradient is cut.

    `judge` : "fit", every answer is evaluated as in the paper, or "look", a first look judges all
    answers to a question by what they gain on the candidate that they edit, and one of them is
    evaluated (`ibrid_policy.asking`).
    `baseline` : "group", answers to the same question are compared by their rewards as in the
    paper, or "parent", all of a batch are by what they gain on the candidate that they edit; one
    answer to a question is then enough. `most_gain` : that counts. `advantages` : "mean", distances
    from the mean in standard deviations as in the paper, or "entropic", which is after the best
    answer. `floor` : least standard deviation of what is compared, for the noise of a fit is no
    signal.
    `only_gains` : where answers are compared by what they gain, those among which none gains teach
    nothing; else they teach to avoid what is illegal or known, and with Adam's even steps carry the
    policy away from what it knew.

    `clip_low`, `clip_high` : how far a token's ratio counts, 1 - clip_low to 1 + clip_high.
    `most_weight` : truncation w_max of the importance weights.
    `divergence` : weight of the divergence (KL) from the start; 0 for none. `lora` : rank of
    low-rank adapters, 0 for training everything. `threads` : of torch on the CPU; they are part of
    the result, so the number of workers is not.

    Of a language model: `constrained` : its answers can only be edits of the parent
    (`ibrid_policy.learning.edit_automaton`).
    `longest` : tokens of an answer at most. `question` : tokens of a question at most; details are
    left out of a longer one.

    `alarm`, `stop` : mean |log-probability served - trained| above which the page warns, and above
    which nothing is trained any more.
    """

    contexts: int = 32
    group: int = 16
    epochs: int = 1
    optimizer: str = "adam"
    rate: float | None = None
    decay1: float = 0.9
    decay2: float = 0.98
    longest_gradient: float = 1.0
    judge: str = "fit"
    baseline: str = "group"
    advantages: str = "mean"
    most_gain: float = 1.0
    only_gains: bool = False
    clip_low: float = 0.2
    clip_high: float = 0.28
    most_weight: float = 2.0
    floor: float = 0.02
    divergence: float = 0.0
    lora: int = 0
    threads: int = 1
    constrained: bool = False
    longest: int = 512
    question: int = 16_000
    alarm: float = 0.02
    stop: float = 0.1

    def __post_init__(self) -> None:
        for holds, law, found in _laws(self):
            if not holds:
                raise IbridError(f"{law}, found {found}; change it in the settings of learning")

    @property
    def batch(self) -> int:
        """Answers between two updates."""
        return self.contexts * self.group

    @property
    def handed_in(self) -> int:
        """Answers to a question that are evaluated."""
        return 1 if self.judge == "look" else self.group

    @property
    def by_gain(self) -> bool:
        """Whether answers are compared by what they gain, in place of their rewards."""
        return self.judge == "look" or self.baseline == "parent"

    @property
    def least(self) -> float:
        """What the best of the answers that are compared must lie above to teach anything."""
        return 0.0 if self.only_gains and self.by_gain else -inf

    @property
    def steps(self) -> int:
        """Of a search between two updates."""
        return self.contexts * self.handed_in

    @property
    def lines(self) -> int:
        """Lines of SEARCH, and as many of REPLACE, for which a constrained answer has room; six at
        most.
        """
        return min(6, (self.longest - 30) // 60)

    def rate_of(self, parameters: int) -> float:
        """The step for a model with so many parameters."""
        if self.rate is not None:
            return self.rate
        if self.optimizer == "sgd":
            return RATE_SGD
        if self.lora:
            return RATE_LORA
        return RATE_LARGE if parameters >= LARGE else RATE_SMALL


def _laws(one: LearningSettings) -> Iterator[tuple[bool, str, Any]]:
    """Whether a law holds, the law in words, and what was found."""
    yield one.contexts >= 1, "a batch needs 1 context or more", one.contexts
    yield one.judge in JUDGES, f"judge must be {' or '.join(JUDGES)}", one.judge
    yield one.baseline in BASELINES, f"baseline must be {' or '.join(BASELINES)}", one.baseline
    if one.baseline == "group":
        yield (
            one.group >= 2,
            (
                "a group needs 2 answers or more, since they are compared with one another; give "
                "more, or the baseline parent"
            ),
            one.group,
        )
    yield one.group >= 1, "a group needs 1 answer or more", one.group
    yield (
        one.batch >= 2,
        "a batch needs 2 answers or more, since they are compared with one another",
        one.batch,
    )
    yield one.epochs >= 1, "a batch needs 1 epoch or more", one.epochs
    yield one.threads >= 1, "torch needs 1 thread or more", one.threads
    yield one.longest >= LEAST_ANSWER, f"an answer needs {LEAST_ANSWER} tokens or more", one.longest
    yield one.question >= 1, "a question needs 1 token or more", one.question
    yield one.advantages in WAYS, f"advantages must be {' or '.join(WAYS)}", one.advantages
    yield one.optimizer in OPTIMIZERS, f"optimizer must be {' or '.join(OPTIMIZERS)}", one.optimizer
    yield one.rate is None or 0 < one.rate < inf, "the learning rate must be above zero", one.rate
    for name in ("decay1", "decay2"):
        yield 0 <= getattr(one, name) < 1, f"{name} must be from 0 to below 1", getattr(one, name)
    yield 0 < one.clip_low < 1, "clip_low must be between 0 and 1", one.clip_low
    for name in ("longest_gradient", "most_gain", "clip_high", "most_weight", "alarm", "stop"):
        yield 0 < getattr(one, name) <= inf, f"{name} must be above zero", getattr(one, name)
    for name in ("floor", "divergence"):
        found = getattr(one, name)
        yield isfinite(found) and found >= 0, f"{name} must not be negative", found
    yield one.lora >= 0, "the rank of adapters must be 0 or more", one.lora


#: Profiles by name: of the paper, and one for searches of a few hundred evaluations.
PROFILES: Mapping[str, LearningSettings] = MappingProxyType(
    {
        "paper": LearningSettings(),
        "small": LearningSettings(
            contexts=1,
            group=ANSWERS,
            optimizer="sgd",
            judge="look",
            advantages="entropic",
            only_gains=True,
            divergence=0.1,
        ),
    }
)


def profile(name: str) -> LearningSettings:
    """One of `PROFILES`; IbridError for another name."""
    if name not in PROFILES:
        raise IbridError(
            f"there is no profile of learning called {name[:40]!r}; known are "
            f"{' and '.join(PROFILES)}"
        )
    return PROFILES[name]
