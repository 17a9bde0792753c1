"""The model card: what the policy was trained on, how well it does on what it never saw, and what
it is not.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ibrid_policy.experience.examples import Example
from ibrid_policy.measuring import Measured
from ibrid_policy.training import TrainingSettings


@dataclass(frozen=True)
class Story:
    """What the card tells: sizes, settings, seconds of each stage, and the measurements by name."""

    inverters: int
    seed: int
    parameters: int
    sizes: Mapping[str, int]
    training: TrainingSettings
    examples: Sequence[Example]
    lessons: int
    seconds: Mapping[str, float]
    measured: Mapping[str, Measured]
    command: str


_TEXT = """\
# The small policy of ibrid

A causal transformer ({parameters:,} parameters, {sizes}) that reads a block diagram, the residual of its fit in few levels,
and the scale of edit that is asked for, and writes an edit of the diagram. Its {vocabulary} tokens stand for modules, ports,
parameters and levels; it knows no natural language. `ibrid search --proposer policy` uses it, on one CPU core.

Made by `{command}`. Weights are stored as 16-bit numbers and used as 32-bit ones.

## Data

{inverters:,} inverters, drawn: for each a choice of parts (filter, synchronisation by a PLL, droops or a virtual machine,
current and voltage control, outer loops, feedforward, decoupling, filters, delay, damping, virtual impedance and more), random
parameters at which it is stable, one to three operating points, 16 to 40 frequencies from 5 Hz to 5 kHz, a quarter of them with
noise of 40 to 60 dB. Each was taken apart step by step down to the naive start, with wrong and superfluous parts put in on
the way; each damaged diagram was fitted briefly, in one of two settings: {settings}.
A lesson is a damaged diagram with its residual, and the edit that undoes one damage (or two); it counts by what the repair
gains. {lessons:,} lessons of {examples:,} examples: {kinds}.

No shipped sweep, published parameter set or benchmark inverter is among them, and no example has the structure of one, in
either vocabulary, as its parent or its answer. Parts of these structures are.

Held out from training: every twentieth inverter ("other inverters"), and the families below.

## Training

{steps:,} steps of {batch} lessons, AdamW, learning rate {rate:g} with a cosine schedule, seed {seed}; the loss counts the
tokens of the answers alone. Levels are blurred a little each time. {seconds}

## Measured

One answer drawn at temperature 1 within the grammar. "Valid": leads to another legal structure that a search would fit.
"Exact": makes exactly the edit that undoes the damage, though others may be as good.

| never trained on | questions | valid | exact | exact, one of {tries} | -ln p of an answer |
|---|---|---|---|---|---|
{table}

## Limits

It knows the shipped kinds, at most 64 modules, and puts in no second device; kinds of one's own, fixed numbers and boxes
are not its words. Its habits are those of the drawn inverters: it will hardly propose what
these never have. It proposes; the fit decides.
"""


def card_text(story: Story, vocabulary: int) -> str:
    """The card in Markdown."""
    kinds = Counter(one.what for one in story.examples)
    settings = Counter(one.setting for one in story.examples)
    words = {
        "part": "one part",
        "parts": "two parts",
        "slip": "a slip",
        "beside": "a part, with a slip left beside it",
    }
    return _TEXT.format(
        parameters=story.parameters,
        sizes=", ".join(f"{name} {value}" for name, value in story.sizes.items()),
        vocabulary=vocabulary,
        command=story.command,
        inverters=story.inverters,
        settings=", ".join(f"{name} {number:,}" for name, number in sorted(settings.items())),
        lessons=story.lessons,
        examples=len(story.examples),
        kinds=", ".join(f"{words[name]} {kinds[name]:,}" for name in words),
        steps=story.training.steps,
        batch=story.training.batch,
        rate=story.training.rate,
        seed=story.seed,
        seconds=" ".join(f"{name}: {_minutes(value)}." for name, value in story.seconds.items()),
        tries=next((one.tries for one in story.measured.values()), 0),
        table="\n".join(_row(name, one) for name, one in story.measured.items()),
    )


def _row(name: str, one: Measured) -> str:
    if not one.questions:
        return f"| {name} | 0 | | | | |"
    shares = " | ".join(f"{share:.0%}" for share in (one.valid, one.exact, one.exact_of_several))
    return f"| {name} | {one.questions} | {shares} | {one.loss:.2f} |"


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
