"""Training: AdamW with a cosine schedule on the tokens of the answers, resumable, the same for the
same seed.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from math import cos, pi
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid_policy.backend import device, read_saved, require
from ibrid_policy.lessons import Lesson, LessonBatch, batches

CHECKPOINT = "checkpoint.pt"
#: What helps when it is damaged.
DELETE = "delete it, and run again with --resume to train from the examples that are there"


@dataclass(frozen=True)
class TrainingSettings:
    """`steps` of `batch` lessons; `rate` : the highest learning rate, reached after `warm_up`
    steps; `checkpoint` : steps between two checkpoints.
    """

    steps: int = 16_000
    batch: int = 8
    rate: float = 1e-3
    warm_up: int = 200
    decay: float = 0.05
    clip: float = 1.0
    checkpoint: int = 500
    seed: int = 0


class Trainer:
    """Trains a model on lessons; `step` counts, `run` goes on to the last.

    Each pass over the lessons draws from a generator that follows from the seed and the pass, so
    that a training that was stopped goes on exactly.
    """

    def __init__(
        self, model: Any, lessons: Sequence[Lesson], settings: TrainingSettings, folder: Path
    ) -> None:
        if not lessons:
            raise IbridError("training needs lessons, found none; make experience first")
        torch = require("torch")
        self.model, self.lessons, self.settings, self.folder = (
            model.to(device()),
            lessons,
            settings,
            folder,
        )
        decayed = [one for one in model.parameters() if one.dim() > 1]
        others = [one for one in model.parameters() if one.dim() <= 1]
        groups = [
            {"params": decayed, "weight_decay": settings.decay},
            {"params": others, "weight_decay": 0.0},
        ]
        self.optimizer = torch.optim.AdamW(groups, lr=settings.rate, betas=(0.9, 0.98))
        self.step = 0
        self.losses: list[float] = []

    def run(self, watch: Callable[["Trainer"], None] = lambda _: None) -> None:
        """Train up to the last step; a checkpoint now and then and at the end."""
        self.model.train()
        for batch in self._batches():
            self.losses.append(self._learn(batch))
            self.step += 1
            if self.step % self.settings.checkpoint == 0 or self.step == self.settings.steps:
                self.save()
            watch(self)

    def rate_at(self, step: int) -> float:
        """Learning rate: linear to the highest, then half a cosine down to a twentieth."""
        one = self.settings
        if step < one.warm_up:
            return one.rate * (step + 1) / one.warm_up
        part = (step - one.warm_up) / max(one.steps - one.warm_up, 1)
        return one.rate * (0.05 + 0.475 * (1 + cos(pi * min(part, 1.0))))

    def save(self) -> None:
        """Model, optimiser and step, replaced at once."""
        torch = require("torch")
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / CHECKPOINT
        state = {
            "step": self.step,
            "losses": self.losses,
            "model": self.model.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "settings": asdict(self.settings),
            "lessons": len(self.lessons),
        }
        torch.save(state, path.with_suffix(".new"))
        os.replace(path.with_suffix(".new"), path)

    def resume(self) -> bool:
        """Take over the checkpoint of the folder; False when there is none.

        Raises IbridError for one that is damaged or of another training.
        """
        path = self.folder / CHECKPOINT
        if not path.is_file():
            return False
        state = read_saved(path, DELETE)
        try:
            if state["settings"] != asdict(self.settings) or state["lessons"] != len(self.lessons):
                raise IbridError(
                    f"{path}: belongs to a training with other settings or examples; delete it, or "
                    "go on as before"
                )
            self.model.load_state_dict(state["model"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.step, self.losses = int(state["step"]), list(state["losses"])
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
            raise IbridError(
                f"{path}: does not fit ({' '.join(str(error).split())[:120]}); {DELETE}"
            ) from None
        return True

    def _batches(self) -> Iterator[LessonBatch]:
        """The batches from the present step on."""
        size, steps = self.settings.batch, self.settings.steps
        in_a_pass = -(-len(self.lessons) // size)
        while self.step < steps:
            number, skipped = divmod(self.step, in_a_pass)
            rng = np.random.default_rng([self.settings.seed, number])
            for place, batch in enumerate(batches(self.lessons, size, rng)):
                if place >= skipped and self.step < steps:
                    yield batch

    def _learn(self, batch: LessonBatch) -> float:
        torch = require("torch")
        for group in self.optimizer.param_groups:
            group["lr"] = self.rate_at(self.step)
        loss = answer_loss(self.model, batch)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.settings.clip)
        self.optimizer.step()
        return float(loss.detach())


def answer_loss(model: Any, batch: LessonBatch) -> Any:
    """Mean of -log p over the tokens of the answers, each with its weight, among what the grammar
    allows; a torch scalar.

    What the grammar decides need not be learnt, and is asked of the model in the same way later.
    """
    torch = require("torch")
    tokens, target, weight, position, sees, allowed = (
        torch.from_numpy(one).to(model.device)
        for one in (
            batch.tokens,
            batch.target,
            batch.weight,
            batch.position,
            batch.sees,
            batch.allowed,
        )
    )
    hidden = model.model(
        input_ids=tokens, attention_mask=sees, position_ids=position, use_cache=False
    ).last_hidden_state
    asked = target >= 0
    logits = model.lm_head(hidden[asked]).float().masked_fill(~allowed, -torch.inf)
    weight = weight[asked].float()
    each = torch.nn.functional.cross_entropy(logits, target[asked], reduction="none")
    return (each * weight).sum() / weight.sum()
