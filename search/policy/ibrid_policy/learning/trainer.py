"""One update from a batch of groups: gradient of the objective, a step, and what it did to the
policy; torch.

One trainer has one model, the one that is sampled from, so what is served after an update is what
was trained.
"""

import copy
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from ibrid_policy.backend import threads
from ibrid_policy.interface import Sampled
from ibrid_policy.learning.adapters import add_adapters, without_adapters
from ibrid_policy.learning.objective import divergence, group_objective, over_answers
from ibrid_policy.learning.probe import Probe, probe
from ibrid_policy.learning.scoring import Scored, score
from ibrid_policy.learning.settings import LearningSettings


@dataclass(frozen=True)
class Group:
    """Answers to one question.

    `masks` : as of `ibrid_policy.interface.Policy.masks`. `advantages` : (N,).
    """

    prompt: tuple[int, ...]
    answers: tuple[Sampled, ...]
    masks: tuple[np.ndarray | None, ...]
    advantages: np.ndarray


@dataclass(frozen=True)
class Trained:
    """Means over the tokens of a batch, before its update but for `clipped`.

    `entropy` : nats. `divergence` : from the policy at the start. `weight`, `largest_weight` : of
    importance. `clipped` : share of tokens whose gradient the clip took away. `drift` :
    |log-probability served - trained|. `gradient` : norm.
    `updated` : False when the drift was too large.
    """

    entropy: float
    divergence: float
    weight: float
    largest_weight: float
    clipped: float
    drift: float
    gradient: float
    updated: bool


class RewardTrainer:
    """Steps up the objective of `ibrid_policy.learning.objective`; everything on the device and in
    the threads of `settings`.
    """

    def __init__(self, model: Any, settings: LearningSettings, seed: int = 0) -> None:
        self.model, self.settings = model.eval(), settings
        self.start = fingerprint(model)
        self.reference = None if settings.lora else copy.deepcopy(model).requires_grad_(False)
        model.requires_grad_(True)
        if settings.lora:
            add_adapters(model, settings.lora, seed)
        self.trained = {name: one for name, one in model.named_parameters() if one.requires_grad}
        self.rate = settings.rate_of(sum(one.numel() for one in model.parameters()))
        self.optimizer = _optimizer(list(self.trained.values()), self.rate, settings)
        self._before: Mapping[str, torch.Tensor] = {}  # the last update

    def score(self, group: Group) -> Scored:
        """Log-probabilities of a group's answers under the model as it is."""
        return score(self.model, group.prompt, [one.tokens for one in group.answers], group.masks)

    def probe(self, group: Group) -> Probe:
        """What a group of answers, drawn after an update, says about the weights that gave them."""
        with self._threads(), torch.no_grad():
            scored = self.score(group)
            with self._as_before():
                before = self.score(group).logprobs
            rows = (self._served(group, scored), before, scored.logprobs)
            served, before, after = (one[scored.real].double().cpu().numpy() for one in rows)
        return probe(served, before, after)

    def update(self, groups: Sequence[Group]) -> Trained:
        """One update for each epoch; none when the answers were served by another policy than the
        trained one.
        """
        old: list[torch.Tensor | None] = [None] * len(groups)
        measured: list[Mapping[str, float]] = []
        clipped, gradient, updated = 0.0, 0.0, True
        with self._threads():
            if self.settings.epochs > 1:
                with torch.no_grad():
                    old = [self.score(group).logprobs for group in groups]
            for epoch in range(self.settings.epochs):
                self.optimizer.zero_grad(set_to_none=True)
                shares = [
                    self._backward(group, before, len(groups))
                    for group, before in zip(groups, old, strict=True)
                ]
                measured = measured or shares
                clipped = _weighted(shares, "clipped")
                if epoch == 0 and not _weighted(shares, "drift") <= self.settings.stop:
                    updated = False
                    break
                cut = torch.nn.utils.clip_grad_norm_(
                    self.trained.values(), self.settings.longest_gradient
                )
                gradient = gradient or float(cut)
                if epoch == 0:
                    self._before = {
                        name: one.detach().clone() for name, one in self.trained.items()
                    }
                self.optimizer.step()
            self.optimizer.zero_grad(set_to_none=True)
        return Trained(
            entropy=_weighted(measured, "entropy"),
            divergence=_weighted(measured, "divergence"),
            weight=_weighted(measured, "weight"),
            largest_weight=max(one["largest_weight"] for one in measured),
            clipped=clipped,
            drift=_weighted(measured, "drift"),
            gradient=gradient,
            updated=updated,
        )

    def state(self) -> dict[str, Any]:
        """Weights that are trained, the state of the optimizer and of torch's random numbers."""
        weights = {name: one.detach().cpu() for name, one in self.trained.items()}
        return {
            "weights": weights,
            "optimizer": self.optimizer.state_dict(),
            "random": torch.get_rng_state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave; ValueError, KeyError or RuntimeError when it is that of
        another model.
        """
        if set(state["weights"]) != set(self.trained):
            raise ValueError("it holds the weights of another model")
        for name, one in self.trained.items():
            if state["weights"][name].shape != one.shape:
                raise ValueError(f"{name} has other numbers of rows or columns")
        self._put(state["weights"])
        self.optimizer.load_state_dict(state["optimizer"])
        torch.set_rng_state(state["random"])

    def _backward(self, group: Group, old: torch.Tensor | None, groups: int) -> Mapping[str, float]:
        """Add the gradient of one group's share of the objective; returns what there is to say of
        its tokens.
        """
        settings = self.settings
        scored = self.score(group)
        before = scored.logprobs.detach() if old is None else old
        served = self._served(group, scored)
        found = group_objective(
            scored.logprobs,
            before,
            served,
            torch.tensor(group.advantages).to(scored.logprobs),
            scored.real,
            low=settings.clip_low,
            high=settings.clip_high,
            most=settings.most_weight,
        )
        with torch.no_grad():
            begun = self._begun(group)
        away = divergence(scored.logprobs, begun)
        loss = -found.value
        if settings.divergence:
            loss = loss + settings.divergence * over_answers(away, scored.real)
        (loss / groups).backward()
        return {
            "tokens": float(scored.real.sum()),
            "entropy": _mean(scored.entropy, scored.real),
            "divergence": _mean(away.detach(), scored.real),
            "drift": _mean((before - served).abs(), scored.real),
            "weight": found.weight,
            "largest_weight": found.largest_weight,
            "clipped": found.clipped,
        }

    def _begun(self, group: Group) -> torch.Tensor:
        """Log-probabilities of a group's answers under the policy at the start: a copy, or the
        model without its adapters.
        """
        answers = [one.tokens for one in group.answers]
        if self.reference is not None:
            return score(self.reference, group.prompt, answers, group.masks).logprobs
        with without_adapters(self.model):
            return score(self.model, group.prompt, answers, group.masks).logprobs

    @contextmanager
    def _as_before(self) -> Iterator[None]:
        """Within, the weights are those before the last update."""
        after = {name: one.detach().clone() for name, one in self.trained.items()}
        self._put(self._before)
        try:
            yield
        finally:
            self._put(after)

    def _put(self, weights: Mapping[str, torch.Tensor]) -> None:
        with torch.no_grad():
            for name, one in weights.items():
                self.trained[name].copy_(one)

    def _served(self, group: Group, scored: Scored) -> torch.Tensor:
        longest = scored.real.shape[1]
        rows = [[*one.logprobs, *[0.0] * (longest - len(one.logprobs))] for one in group.answers]
        return torch.tensor(rows).to(scored.logprobs)

    def _threads(self) -> AbstractContextManager[None]:
        """The number decides in which order sums are made, so it is part of the result."""
        return threads(self.settings.threads)


def _optimizer(
    weights: list[torch.Tensor], rate: float, settings: LearningSettings
) -> torch.optim.Optimizer:
    if settings.optimizer == "sgd":
        return torch.optim.SGD(weights, lr=rate)
    return torch.optim.Adam(weights, lr=rate, betas=(settings.decay1, settings.decay2))


def fingerprint(model: Any) -> str:
    """What tells the weights of a model from others."""
    found = hashlib.sha256()
    for name, one in model.state_dict().items():
        found.update(name.encode())
        found.update(one.detach().cpu().contiguous().flatten().view(torch.uint8).numpy())
    return found.hexdigest()[:32]


def _mean(values: torch.Tensor, real: torch.Tensor) -> float:
    return float((values * real).sum() / real.sum().clamp(min=1))


def _weighted(shares: Sequence[Mapping[str, float]], name: str) -> float:
    """Mean over the tokens of all groups."""
    tokens = sum(one["tokens"] for one in shares)
    return sum(one["tokens"] * one[name] for one in shares) / tokens if tokens else 0.0
