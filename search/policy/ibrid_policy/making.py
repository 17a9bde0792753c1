"""A policy from nothing: experience drawn and fitted, the model trained, measured on what it never
saw, and written.

DIR/experience/, DIR/held_out/   shards of examples
DIR/training.json                what was asked for, and the seconds of each stage
DIR/checkpoint.pt                the training as it stands
DIR/config.json, model.safetensors, vocabulary.json, MODEL_CARD.md
"""

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ibrid_search.recursion.progress import clock_time

from ibrid.errors import IbridError
from ibrid.telling import Tell, telling
from ibrid.writing import write_whole
from ibrid_policy.backend import require
from ibrid_policy.card import Story, card_text
from ibrid_policy.experience.examples import Example
from ibrid_policy.experience.shards import (
    IN_A_SHARD,
    Crew,
    Processes,
    make_shards,
    read_shards,
    shard_path,
)
from ibrid_policy.lessons import lessons_of
from ibrid_policy.measuring import Measured, measured
from ibrid_policy.tokens import TOKENS
from ibrid_policy.training import Trainer, TrainingSettings
from ibrid_policy.weights_folder import SIZES, new_model, save_model

SETTINGS_FILE, EXPERIENCE, HELD_OUT = "training.json", "experience", "held_out"
#: Every so many inverters one is kept for the measurement, and of the held-out families one for so
#: many of the others.
ONE_IN = 20
#: Questions of each measurement, at most.
MOST_QUESTIONS = 150
FAMILIES = ("oscillator", "hybrid", "dc link with voltage control")


@dataclass(frozen=True)
class Order:
    """What is asked for. `inverters` : drawn for training. `size` : of the model, a name in
    `SIZES`.

    Raises IbridError for an unknown size, or too few inverters or steps.
    """

    inverters: int = 2500
    seed: int = 0
    training: TrainingSettings = field(default_factory=TrainingSettings)
    size: str = "small"

    def __post_init__(self) -> None:
        for holds, sentence in (
            (
                self.size in SIZES,
                f"the size of a policy is {' or '.join(SIZES)}, found {self.size!r:.40}",
            ),
            (
                self.inverters >= 2 * ONE_IN,
                f"a policy needs {2 * ONE_IN} inverters or more, found {self.inverters}",
            ),
            (
                self.training.steps >= 1,
                f"training takes 1 step or more, found {self.training.steps}",
            ),
        ):
            if not holds:
                raise IbridError(sentence)

    def described(self) -> dict[str, Any]:
        """Plain data, to compare with at a resume."""
        return {
            "inverters": self.inverters,
            "seed": self.seed,
            "training": vars(self.training),
            "sizes": dict(SIZES[self.size]),
            "tokens": len(TOKENS),
        }

    @property
    def command(self) -> str:
        """What a user types for it."""
        size = "" if self.size == "small" else f" --size {self.size}"
        return (
            f"ibrid policy train --inverters {self.inverters} --steps {self.training.steps} --seed "
            f"{self.seed}{size}"
        )


def train_policy(
    folder: str | Path,
    order: Order,
    *,
    crew: Crew | None = None,
    resume: bool = False,
    show: str = "auto",
) -> Mapping[str, Measured]:
    """Make a policy in a folder; returns how good it is on what it never saw.

    The same order makes the same examples and, on one machine, the same weights. Raises IbridError
    for a folder that holds something else, or an order that differs from the one to be resumed.
    """
    require("torch")
    require("transformers")
    folder = Path(folder)
    seconds = _opened(folder, order, resume)
    crew = crew or Processes(1)
    shards = range(-(-order.inverters // IN_A_SHARD))
    held = range(max(1, len(shards) // ONE_IN))
    with telling(show) as tell:
        with _timed(seconds, "experience", folder, order):
            _draw(folder / EXPERIENCE, order.seed, shards, crew, None, tell)
            _draw(folder / HELD_OUT, order.seed, held, crew, FAMILIES, tell)
        tell("reading the examples", 0.0)
        examples = list(read_shards(folder / EXPERIENCE, shards))
        learnt = [one for one in examples if one.inverter % ONE_IN != ONE_IN - 1]
        kept = [one for one in examples if one.inverter % ONE_IN == ONE_IN - 1]
        lessons = lessons_of(learnt)
        trainer = Trainer(new_model(order.seed, SIZES[order.size]), lessons, order.training, folder)
        if resume:
            trainer.resume()
        with _timed(seconds, "training", folder, order):
            _train(trainer, tell)
        with _timed(seconds, "measurement", folder, order):
            found = _measured(
                trainer.model, kept, list(read_shards(folder / HELD_OUT, held)), order.seed, tell
            )
    story = Story(
        inverters=order.inverters,
        seed=order.seed,
        parameters=sum(one.numel() for one in trainer.model.parameters()),
        sizes=SIZES[order.size],
        training=order.training,
        examples=learnt,
        lessons=len(lessons),
        seconds=seconds,
        measured=found,
        command=order.command,
    )
    save_model(trainer.model, folder, card_text(story, len(TOKENS)))
    return found


def _opened(folder: Path, order: Order, resume: bool) -> dict[str, float]:
    """Seconds that earlier sittings took."""
    path = folder / SETTINGS_FILE
    if folder.is_dir() and any(folder.iterdir()):
        if not resume:
            raise IbridError(
                f"{folder}: holds something already; go on with --resume, or name a new folder"
            )
        if not path.is_file():
            raise IbridError(
                f"{folder}: holds no training to resume; name a new folder, without --resume"
            )
    elif resume:
        raise IbridError(f"{folder}: holds no training to resume; leave --resume out")
    if not path.is_file():
        _mkdir(folder)
        _write(folder, order, {})
        return {}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        asked, seconds = (
            found["order"],
            {name: float(value) for name, value in found["seconds"].items()},
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise IbridError(
            f"{path}: is not readable as the settings of a training; name a new folder"
        ) from None
    wanted = json.loads(json.dumps(order.described()))
    if asked != wanted:
        other = [name for name in wanted if asked.get(name) != wanted[name]]
        raise IbridError(
            f"{folder}: was begun with other {', '.join(other)}; give the same options, or name a "
            "new folder"
        )
    return seconds


def _mkdir(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise IbridError(
            f"{folder}: cannot be made ({error.strerror}); choose another place"
        ) from None


def _write(folder: Path, order: Order, seconds: Mapping[str, float]) -> None:
    write_whole(
        folder / SETTINGS_FILE,
        json.dumps({"order": order.described(), "seconds": dict(seconds)}, indent=1) + "\n",
    )


@contextmanager
def _timed(seconds: dict[str, float], stage: str, folder: Path, order: Order) -> Iterator[None]:
    """Adds the time of a stage to that of earlier sittings, also when it is broken off."""
    began, before = time.monotonic(), seconds.get(stage, 0.0)
    try:
        yield
    finally:
        seconds[stage] = before + time.monotonic() - began
        _write(folder, order, seconds)


def _draw(folder: Path, seed: int, shards: range, crew: Crew, families: Any, tell: Tell) -> None:
    began, there = time.monotonic(), sum(shard_path(folder, one).is_file() for one in shards)
    what = "experience" if families is None else "experience of held-out families"
    made = examples = 0
    tell(
        f"{what}: {there * IN_A_SHARD} of {len(shards) * IN_A_SHARD} inverters", there / len(shards)
    )
    for _, number in make_shards(folder, seed, shards, crew, families):
        made, examples = made + 1, examples + number
        done = there + made
        left = (time.monotonic() - began) / made * (len(shards) - done)
        tell(
            f"{what}: {done * IN_A_SHARD} of {len(shards) * IN_A_SHARD} inverters, {examples} new "
            "examples, "
            f"ETA {clock_time(left)}",
            done / len(shards),
        )


def _train(trainer: Trainer, tell: Tell) -> None:
    began, first, steps = time.monotonic(), trainer.step, trainer.settings.steps

    def watch(one: Trainer) -> None:
        left = (time.monotonic() - began) / (one.step - first) * (steps - one.step)
        loss = float(np.mean(one.losses[-50:]))
        tell(
            f"training: step {one.step} of {steps}, loss {loss:.3f} a token, ETA "
            f"{clock_time(left)}",
            one.step / steps,
        )

    trainer.run(watch)


def _measured(
    model: Any, kept: list[Example], held: list[Example], seed: int, tell: Tell
) -> dict[str, Measured]:
    groups = {
        "other inverters": kept,
        **{family: [one for one in held if one.family == family] for family in FAMILIES},
    }
    found = {}
    for name, group in groups.items():
        rng = np.random.default_rng([seed, 99])
        chosen = [group[one] for one in rng.permutation(len(group))[:MOST_QUESTIONS]]

        def watch(done: int, total: int, name: str = name) -> None:
            tell(f"measuring on {name}: {done} of {total} questions", done / total)

        found[name] = measured(model, chosen, seed=seed, watch=watch)
    return found
