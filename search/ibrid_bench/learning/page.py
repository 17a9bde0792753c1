"""The page docs/learning_results.md, made from the rows of the ledger."""

from collections.abc import Iterable

from ibrid_bench.learning.arms import ALL_ARMS, ARMS, DRAWN, HELD_OUT, INVERTERS, KNOWN, PROFILE, SEEDS, Case, arm_of
from ibrid_bench.learning.comparison import (
    Row,
    Rows,
    budgets,
    current,
    labels,
    longest_of_chance,
    newest_weights,
    pairs,
)
from ibrid_bench.learning.tables import (
    answers_table,
    arms_table,
    inverters_table,
    pairs_table,
    sentences,
    updates_table,
)
from ibrid_policy.learning.settings import PROFILES

_TOP = """# Does learning help?

Made by `make bench-learning`, which keeps what it has measured and goes on where it was stopped; no number here is typed
by hand. The same searches by five proposers, at equal numbers of evaluations. A first look is a few steps of a fit, a tenth of
an evaluation in time; `rules` and the policy take some, and they do not count:

{arms}
`frozen` is what `learning small` would be without its updates: both draw eight answers to a question and choose one of them in
the same way, with a look every other time. Learning looks at all answers to every question, so it takes twice as many looks,
but the others only teach.{controls}

On hidden inverters, from the naive diagram, clean data, 16 frequencies from 5 Hz to 5 kHz at p = 1, q = +-0.3, exact
equilibrium, one parameter set. The policy was trained on drawn inverters of the families of
{known};
the structure of `paper_like` itself was kept from it, that of `gfl_l_filter` is two of the 2,500 that it was trained on, with
other parameters (search/policy/ibrid_policy/weights/MODEL_CARD.md). It never saw an inverter of the families of
{held_out}:
DC link with control of the AC voltage, virtual oscillator, droop with a PLL. Drawn inverters, where they are, are of these
families too, another one for every seed.

**To 0.0435, to 1e-3**: evaluations until the best error is at most that; a run that never gets there counts as beyond the
budget, so a median may be "> budget". **Area**: mean over the evaluations of log10 of the best NRMSE so far, 1e-6 at
least; lower is better, and 0.3 is a factor of two. **F1**: of the answer against the truth. Medians stand with 95 %
bootstrap intervals (seeds drawn again within each inverter), from three seeds on where they have a width; they speak of other
seeds on these inverters.

"""
#: Arms that are no part of the comparison, told of where they are measured.
_CONTROLS = {
    "untrained": "A control, `untrained`, learns from evaluations with weights that stay: it sees results only after a batch.",
    "blind": "A control, `blind`, is the frozen policy without first looks.",
}
_PAIRS = """Differences are means over pairs of the same inverter and seed; a limit that was not reached counts as the budget.
Negative is better but for F1. A star: zero lies outside the interval.
"""
_ANSWERS = """Of all answers, several to a question where the policy is asked. Valid: a legal edit that leads to something new;
known: to a structure met before or to the parent's; refused: no legal edit; failed: no fit. Random edits and rules pass over
known structures unseen. Seconds: of a run, its page included. Drawn inverters are included.
"""
_DRAWN = "Another inverter for every seed, so intervals speak of other inverters of these families.\n"
_INVERTERS = "The median of the best error at the end, and how many runs came to 0.0435.\n"
_UPDATES = """Means over eight parts of the updates of each run, then over the runs, those on drawn inverters included. Reward and
gain on the parent: of an answer; siblings: answers that repeat another of their batch; entropy and divergence from the start in
nats per token; clipped: share of the tokens whose gradient was cut off; drift: between the weights that answer and those that
are trained.
"""
_TRIED = """Other settings than the profile `{profile}`, most of them measured on the way to it, on fewer seeds. A label names the
questions of a batch x the answers to each, and what is not the default. From before first looks: `blind`, `rate`, `epochs`,
`parent`; tried and gone, as `search/LOG.md` tells: `alone` (questions to which no answer gains teach too), `halved` (half of
the questions go to the policy as it ships) and `tries` (the policy is asked again after an answer that leads to nothing new).
"""


def page(rows: Iterable[Row]) -> str:
    """Markdown: a section for each budget; what is missing says so."""
    kept = current(rows)
    weights = newest_weights(kept)
    text = _TOP.format(
        arms="".join(f"- **{name}**: {ALL_ARMS[name].words}\n" for name in ARMS),
        controls="".join(
            f" {_CONTROLS[name]}" for name in _CONTROLS if any(arm_of(row["arm"]) == name for row in kept)
        ),
        known=_names(KNOWN),
        held_out=_names(HELD_OUT),
    )
    if weights:
        text += f"Weights of the policy: `{weights}`.\n\n"
    chance = longest_of_chance(kept)
    parts = [_section([row for row in kept if row["budget"] == one], one, chance) for one in budgets(kept)]
    return (text + ("".join(parts) or f"{measured_of([])}\n")).rstrip() + "\n"


def measured_of(rows: Rows) -> str:
    """How much of the comparison with one budget is there, in a sentence."""
    whole = len(INVERTERS) * len(ARMS) * SEEDS
    compared = _compared(ARMS)
    asked = {
        (row["inverter"], row["arm"], row["seed"])
        for row in rows
        if row["arm"] in compared and row["inverter"] in INVERTERS and row["seed"] < SEEDS
    }
    runs = f"of the {whole} runs ({len(INVERTERS)} inverters, {len(ARMS)} arms, {SEEDS} seeds)"
    return f"{len(asked)} {runs} are measured." if asked else f"None {runs} is measured yet."


def _compared(arms: Iterable[str]) -> set[str]:
    """What the rows of these arms are called, those of learning with the profile that is compared."""
    return {Case("", arm, 0, 1, PROFILES[PROFILE], "").label for arm in arms}


def _section(rows: Rows, budget: int, chance: Rows) -> str:
    known = _compared(ALL_ARMS)
    compared = [row for row in rows if row["arm"] in known]
    told = "".join(f"- {one}\n" for one in sentences(compared, chance))
    parts = [
        f"## {budget} evaluations\n\n{measured_of(rows)}\n\n{told}",
        f"### Every arm, all inverters\n\n{arms_table(compared)}",
        f"### Every arm, families it was trained on\n\n{arms_table(compared, KNOWN)}",
        f"### Every arm, held-out families\n\n{arms_table(compared, HELD_OUT)}",
        *_of_drawn("### Every arm", compared),
        f"### Differences\n\n{_PAIRS}\n{pairs_table(compared)}",
        f"### What became of the answers\n\n{_ANSWERS}\n{answers_table(compared)}",
        f"### Every inverter\n\n{_INVERTERS}\n{inverters_table(compared)}",
        f"### The updates\n\n{_UPDATES}\n{updates_table(compared)}",
    ]
    return "\n".join([*parts, *_tried(rows)]) + "\n"


def _of_drawn(title: str, rows: Rows) -> list[str]:
    if not any(row["inverter"] in DRAWN for row in rows):
        return []
    return [f"{title}, drawn inverters of held-out families\n\n{_DRAWN}\n{arms_table(rows, DRAWN)}"]


def _tried(rows: Rows) -> list[str]:
    """Other ways of learning beside the arms that they are compared with."""
    known = _compared(ALL_ARMS)
    tried = [row for row in rows if row["arm"] not in known]
    if not tried:
        return []
    of_tried = [pair for pair in pairs(labels(rows)) if not known.issuperset(pair)]
    return [
        f"### Other ways of learning\n\n{_TRIED.format(profile=PROFILE)}\n{arms_table(tried)}",
        *_of_drawn("#### The same", tried),
        f"#### Differences\n\n{pairs_table(rows, of_tried)}",
        f"#### The updates\n\n{updates_table(tried)}",
    ]


def _names(names: Iterable[str]) -> str:
    *first, last = (f"`{name}`" for name in names)
    return f"{', '.join(first)} and {last}"
