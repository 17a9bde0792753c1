"""What is compared, and on what: the arms, the hidden inverters, and one search of the
comparison.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ibrid_bench.learning.drawn import FAMILIES
from ibrid_policy.learning.settings import PROFILES, LearningSettings
from ibrid_policy.weights_folder import WEIGHTS_FILE, shipped_folder

from ibrid.errors import IbridError, near

#: Seeds of the whole comparison; fewer are a part of it.
SEEDS = 10
#: Of families that the policy was trained on. The structure of `paper_like` itself was kept from
#: it.
KNOWN = ("paper_like", "gfl_l_filter", "gfm_droop")
#: Of families of which the policy never saw one: DC link with control of the AC voltage, virtual
#: oscillator, hybrid.
HELD_OUT = ("gfl_dc_link", "gfm_dvoc", "hybrid_gfl_gfm")
INVERTERS = (*KNOWN, *HELD_OUT)
#: Of the same families, another inverter for every seed; searched when they are asked for.
DRAWN = tuple(FAMILIES)
#: Of learning, unless another is asked for.
PROFILE = "small"


@dataclass(frozen=True)
class Arm:
    """`proposer` : as for `ibrid.search`. `learns` : whether `learn` is given. `rate` : of the
    step; None: as asked for.
    `blind` : True where the policy takes no first looks. `informed` : where the diagnosis is among
    its answers.
    """

    words: str
    proposer: str
    learns: bool = False
    rate: float | None = None
    blind: bool = False
    informed: bool = False

    @property
    def asks_policy(self) -> bool:
        """True where the weights of the policy matter."""
        return "policy" in self.proposer


#: Steps of a weight by which no 32-bit number changes.
NO_STEP = 1e-30
#: Those that are not among `ARMS` are its controls, made when they are asked for: learning from
#: evaluations but for the change of the weights, as where looks judge `frozen` is; what the policy
#: is without first looks; and beside the diagnosis.
ALL_ARMS: Mapping[str, Arm] = MappingProxyType(
    {
        "random": Arm("legal edits by chance", "random"),
        "rules": Arm("rules of thumb and a first look at the data", "rules"),
        "frozen": Arm("the policy as it ships, with first looks at its answers", "policy"),
        "learning": Arm("the policy, trained on the way", "policy", learns=True),
        "mixed": Arm("the policy as it ships and rules, half each", "policy:0.5,rules:0.5"),
        "untrained": Arm("as learning, weights unchanged", "policy", learns=True, rate=NO_STEP),
        "blind": Arm("the policy as it ships, without first looks", "policy", blind=True),
        "diagnosis": Arm(
            "what looks say of every edit that control practice knows, the default", "diagnosis"
        ),
        "informed": Arm(
            "the policy as it ships, the diagnosis among its answers", "policy", informed=True
        ),
    }
)
ARMS = ("random", "rules", "frozen", "learning", "mixed")


@dataclass(frozen=True)
class Case:
    """One search.

    `arm` : of `ALL_ARMS`. `settings` : of learning. `weights` : of the policy, see
    `weights_digest`.
    """

    inverter: str
    arm: str
    seed: int
    budget: int
    settings: LearningSettings
    weights: str

    @property
    def label(self) -> str:
        """The arm; where it asks by the batch how: the profile, or the size of a batch and what is
        not the default, "learning small" or "learning 4x8 entropic"; of the control the size alone.
        """
        one = ALL_ARMS[self.arm]
        if not one.learns:
            return self.arm
        settings = self.settings
        if one.rate is not None:
            return f"{self.arm} {size(settings)}"
        if found := [name for name, profile in PROFILES.items() if profile == settings]:
            return f"{self.arm} {found[0]}"
        changes = _changes(settings)
        ways = [
            changes[name] for name in ("baseline", "advantages", "optimizer") if name in changes
        ]
        numbers = [f"{name} {changes[name]:g}" for name in ("rate", "epochs") if name in changes]
        return " ".join([self.arm, size(settings), *ways, *numbers])

    @property
    def key(self) -> str:
        """Names the row in the ledger; what would change the result of the arm is part of it."""
        one = ALL_ARMS[self.arm]
        words = [self.inverter, *self.label.split(), str(self.budget), str(self.seed)]
        if one.asks_policy:
            words.append(self.weights)
        if one.learns and one.rate is None:
            words.append(sha256(repr(_changes(self.settings)).encode()).hexdigest()[:8])
        return "-".join(words)


def size(settings: LearningSettings) -> str:
    """Of a batch: questions x answers to each, and who judges them where the search does not, "8x8
    look".
    """
    judge = "" if settings.judge == "fit" else f" {settings.judge}"
    return f"{settings.contexts}x{settings.group}{judge}"


def controls(label: str) -> tuple[str, str]:
    """Labels of the policy that learning of a label begins with, and of what tells it from what
    comes with it.
    """
    told = label.split()[1:]
    name = (
        size(PROFILES[told[0]])
        if told[0] in PROFILES
        else " ".join(told[: 2 if told[1:2] == ["look"] else 1])
    )
    return "frozen" if name.endswith("look") else "blind", f"untrained {name}"


def _changes(settings: LearningSettings) -> dict[str, Any]:
    """What is not the default, so that a setting that is new changes no key."""
    default = asdict(LearningSettings())
    return {name: found for name, found in asdict(settings).items() if found != default[name]}


def cases(
    seeds: int,
    budget: int,
    settings: LearningSettings,
    *,
    inverters: Sequence[str] = (),
    arms: Sequence[str] = (),
    weights: str = "",
) -> Iterator[Case]:
    """All searches, seed by seed, inverter by inverter, arm beside arm, so that a part of them is a
    fair comparison too.

    inverters, arms : none for all of `INVERTERS` and `ARMS`. Raises IbridError for an unknown one,
    with near names.
    """
    for asked, known, what in (
        (inverters, (*INVERTERS, *DRAWN), "inverter of this comparison"),
        (arms, ALL_ARMS, "arm"),
    ):
        for name in asked:
            if name not in known:
                raise IbridError(f"there is no {what} called {name}; {near(name, known)}")
    for seed in range(seeds):
        for inverter in inverters or INVERTERS:
            for arm in arms or ARMS:
                yield Case(inverter, arm, seed, budget, settings, weights)


def arm_of(label: str) -> str:
    """The arm of a label."""
    return label.partition(" ")[0]


def weights_digest(folder: Path | None = None) -> str:
    """Twelve letters that belong to the weights of a policy, None: those that ship; "none" where
    there are none.
    """
    try:
        content = ((folder or shipped_folder()) / WEIGHTS_FILE).read_bytes()
    except OSError:
        return "none"
    return sha256(content).hexdigest()[:12]
