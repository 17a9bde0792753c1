"""What a run has learnt so far: the trainer with its weights, every update, and both on disk.
Importing it needs no torch.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from ibrid.errors import IbridError
from ibrid_policy.interface import Policy
from ibrid_policy.learning.checkpoint import read_checkpoint, write_checkpoint
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.updates import META, Update, read_updates, updates_json

if TYPE_CHECKING:
    from ibrid_policy.learning.trainer import RewardTrainer


@runtime_checkable
class Publishes(Protocol):
    """A policy whose answers come from elsewhere than the model that is trained."""

    def publish(self) -> None:
        """Hand the weights as they are to whoever serves them; IbridError when that fails."""
        ...


class LearningState:
    """`path` : of the checkpoint, None for none. `keep` : takes the text about the updates for the
    store. `updates` : so far.
    `stopped` : why nothing is trained any more; "" while it is.
    """

    def __init__(self, policy: Policy, settings: LearningSettings, seed: int) -> None:
        self.policy, self.settings, self.seed = policy, settings, seed
        self.path: Path | None = None
        self.keep: Callable[[str, str], None] = lambda name, text: None
        self.updates: list[Update] = []
        self.stopped = ""

    @cached_property
    def trainer(self) -> "RewardTrainer":
        """Made when it is needed, since torch is slow to import; with the weights of an earlier
        sitting.

        Raises IbridError for a model that cannot be loaded, or a checkpoint that is damaged or
        another model's.
        """
        from ibrid_policy.learning.trainer import RewardTrainer

        trainer = RewardTrainer(self.policy.model(), self.settings, self.seed)
        state = None if self.path is None else read_checkpoint(self.path)
        if state is not None:
            self._restore(trainer, state)
        return trainer

    @property
    def seen(self) -> int:
        """Batches that the weights have seen."""
        _ = self.trainer
        return len(self.updates)

    def require_seen(self, batches: int) -> None:
        """Raise IbridError unless the weights have seen so many batches."""
        if self.seen != batches:
            raise IbridError(
                f"{self.path}: the weights have seen {self.seen} batches, but the steps hold "
                f"{batches}; restore the folder of "
                "the run, or start a new run"
            )

    def conclude(self, update: Update) -> None:
        """Keep the weights with the update that made them, in one file, and tell the store."""
        self.updates.append(update)
        text = updates_json(self.updates)
        if self.path is not None:
            state = {
                "updates": text,
                "start": self.trainer.start,
                "stopped": self.stopped,
                **self.trainer.state(),
            }
            write_checkpoint(self.path, state)
        self.keep(META, text)

    def publish(self) -> None:
        """Hand the weights to the server of a policy that has one."""
        if isinstance(self.policy, Publishes):
            self.policy.publish()

    def _restore(self, trainer: "RewardTrainer", state: Mapping[str, Any]) -> None:
        if state.get("start") != trainer.start:
            raise IbridError(
                f"{self.path}: belongs to a model with other weights; resume with the one it was "
                "made with"
            )
        try:
            trainer.restore(state)
            self.updates, self.stopped = list(read_updates(state["updates"])), str(state["stopped"])
        except (KeyError, ValueError, RuntimeError, TypeError) as error:
            raise IbridError(
                f"{self.path}: does not fit ({error!s:.120}); restore it, or start a new run"
            ) from None
        self.keep(META, updates_json(self.updates))
        self.publish()
