"""A trial of the benchmark: which device is drawn, how it is measured, and the one word from which
all of it follows.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from ibrid_bench.hidden.case import KINDS, WRONG_NOISE_DB, Case, Kind, draw_case
from ibrid_bench.hidden.declaration import SEVERITIES, HiddenEffect, Severity
from ibrid_bench.hidden.effects import HIDDEN
from ibrid_bench.hidden.elsewhere import CONVENTIONS, FOREIGN

from ibrid.errors import IbridError

#: (noise in dB below the norm of Y or None for clean, frequencies, operating points).
Setting = tuple[float | None, int, int]
#: Two operating points and 16 frequencies: what targets are stated for, and this share of all
#: trials.
MAIN: tuple[Setting, ...] = ((None, 16, 2), (60.0, 16, 2), (40.0, 16, 2))
MAIN_SHARE = 0.75
ELSEWHERE: tuple[Setting, ...] = tuple(
    (noise, frequencies, points)
    for noise in (None, 60.0, 40.0, 20.0)
    for frequencies in (16, 60)
    for points in (1, 2, 4)
    if (noise, frequencies, points) not in MAIN
)
#: Trials of each kind in a table of 200.
NUMBERS: Mapping[Kind, int] = {
    "effect": 110,
    "nothing": 20,
    "parameters": 20,
    "pair": 20,
    "foreign": 15,
    "convention": 10,
    "wrong-noise": 5,
}
_POOLS: Mapping[Kind, tuple[HiddenEffect, ...]] = {
    "effect": HIDDEN,
    "foreign": FOREIGN,
    "convention": CONVENTIONS,
}
_SEEDS = 10_000
#: One trial more for every so many of a table: noisy, and the file does not say how much.
UNSTATED_EVERY = 10
UNSTATED = "unstated"


@dataclass(frozen=True)
class Trial:
    """A case to draw; see `draw_case`.

    `effects` : "id:change:variant"; those that the kind hides beyond them are drawn.
    """

    kind: Kind
    effects: tuple[str, ...]
    severity: Severity
    noise_db: float | None
    frequencies: int
    points: int
    seed: int
    stated: bool = True

    @property
    def data(self) -> str:
        """clean, or the noise in words."""
        words = "clean" if self.noise_db is None else f"{self.noise_db:g}dB"
        return words if self.stated else f"{words}-{UNSTATED}"

    @property
    def group(self) -> str:
        """By what it is asked for: its kind, or `UNSTATED`."""
        return self.kind if self.stated else UNSTATED

    @property
    def key(self) -> str:
        """Everything about the trial, in one word that `parse` reads."""
        effects = "+".join(self.effects) or "any"
        size = f"{self.frequencies}x{self.points}"
        return "/".join((self.kind, effects, self.severity, self.data, size, str(self.seed)))

    @property
    def folder(self) -> str:
        """The key as the name of a folder."""
        return self.key.replace("/", ",").replace(":", ".")

    @classmethod
    def parse(cls, key: str) -> "Trial":
        """The trial of a key; IbridError when it is none."""
        try:
            kind, effects, severity, data, size, seed = key.split("/")
            frequencies, points = size.split("x")
            level = data.removesuffix(f"-{UNSTATED}")
            noise = None if level == "clean" else float(level.removesuffix("dB"))
            names = () if effects == "any" else tuple(effects.split("+"))
            of_kind, as_strong = KINDS[KINDS.index(kind)], SEVERITIES[SEVERITIES.index(severity)]
            return cls(
                of_kind,
                names,
                as_strong,
                noise,
                int(frequencies),
                int(points),
                int(seed),
                level == data,
            )
        except ValueError:
            raise IbridError(
                f"{key} is no trial; one is KIND/EFFECT/SEVERITY/NOISE/FREQUENCIESxPOINTS/SEED, "
                "such as "
                "effect/control_delay:add:command/clear/60dB/16x2/7"
            ) from None

    def case(self) -> Case:
        """The device, its sweep and the model of it; IbridError where there is none."""
        return self._drawn(self.noise_db)

    def stated_case(self) -> Case:
        """The same with a file that states its noise."""
        return replace(self, stated=True).case()

    def clean_case(self) -> Case:
        """The same measured without noise."""
        return self._drawn(None)

    def _drawn(self, noise_db: float | None) -> Case:
        return draw_case(
            self.kind,
            self.seed,
            effects=self.effects,
            severity=self.severity,
            noise_db=noise_db,
            sigma="known" if self.stated else "none",
            frequencies=self.frequencies,
            points=self.points,
        )


def design(cases: int, seed: int) -> tuple[Trial, ...]:
    """A balanced fraction of effects x severities x settings: so many trials, the same for the same
    seed.

    Every effect comes about equally often, each time in another severity; `MAIN_SHARE` of each kind
    is of the main settings, the rest spread over the others. Seeds of the trials begin at 10,000
    times `seed`.
    """
    rng = np.random.default_rng(seed)
    found: list[Trial] = []
    for kind, number in shares(cases).items():
        effects = _effects(kind, number, rng)
        for (names, severity), setting in zip(effects, _settings(number, rng), strict=True):
            found.append(_trial(kind, names, severity, setting, _SEEDS * seed + len(found)))
    return tuple(found)


def unstated(cases: int, seed: int) -> tuple[Trial, ...]:
    """Trials beside a table of so many: nothing hidden, or one effect, at 60 and 40 dB in turn, and
    no sigma in the file.
    """
    rng = np.random.default_rng([seed, 1])
    number = cases // UNSTATED_EVERY
    nothing: list[tuple[Kind, tuple[str, ...], Severity]] = [("nothing", (), "clear")] * (
        number - number // 2
    )
    hidden: list[tuple[Kind, tuple[str, ...], Severity]] = [
        ("effect", names, severity) for names, severity in _effects("effect", number // 2, rng)
    ]
    first = _SEEDS * seed + cases
    return tuple(
        Trial(
            kind,
            names,
            severity,
            (60.0, 40.0)[place % 2],
            *MAIN[0][1:],
            first + place,
            stated=False,
        )
        for place, (kind, names, severity) in enumerate(nothing + hidden)
    )


def shares(cases: int) -> dict[Kind, int]:
    """How many trials of each kind a smaller or larger table has; the rounding goes to the largest
    remainders.
    """
    total = sum(NUMBERS.values())
    found: dict[Kind, int] = {kind: cases * number // total for kind, number in NUMBERS.items()}
    remainders = {kind: cases * number % total for kind, number in NUMBERS.items()}
    for kind in sorted(found, key=lambda one: -remainders[one])[: cases - sum(found.values())]:
        found[kind] += 1
    return found


def _trial(
    kind: Kind, names: tuple[str, ...], severity: Severity, setting: Setting, seed: int
) -> Trial:
    noise, frequencies, points = setting
    if kind == "wrong-noise" and noise is None:
        noise = WRONG_NOISE_DB
    if any(name.startswith("operating_point") for name in names):
        points = max(points, 2)  # labels can be exchanged
    return Trial(kind, names, severity, noise, frequencies, points, seed)


def _effects(
    kind: Kind, number: int, rng: np.random.Generator
) -> list[tuple[tuple[str, ...], Severity]]:
    """Names and severities: round after round of the pool, each effect in another severity than the
    round before.
    """
    pool = [(one.key,) for one in _POOLS.get(kind, ())] or [()]
    first = _balanced(len(SEVERITIES), len(pool), rng)
    chosen = _balanced(len(pool), number, rng)
    return [
        (pool[one], SEVERITIES[(first[one] + k // len(pool)) % len(SEVERITIES)])
        for k, one in enumerate(chosen)
    ]


def _settings(number: int, rng: np.random.Generator) -> list[Setting]:
    main = round(MAIN_SHARE * number)
    chosen = [MAIN[one] for one in _balanced(len(MAIN), main, rng)]
    chosen += [ELSEWHERE[one] for one in _balanced(len(ELSEWHERE), number - main, rng)]
    return [chosen[one] for one in rng.permutation(number)]


def _balanced(levels: int, number: int, rng: np.random.Generator) -> list[int]:
    """So many levels out of 0, 1, ...: round after round of all of them, each round in an order of
    its own.
    """
    rounds = [int(one) for _ in range(0, number, levels) for one in rng.permutation(levels)]
    return rounds[:number]
