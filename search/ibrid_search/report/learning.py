"""The course of learning over the updates of a run, drawn."""

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

from ibrid.report.figure import inline_svg
from ibrid.report.learning import course, draw_courses
from ibrid_search.policy_package import UPDATES, policy_part
from ibrid_search.report.run_data import RunData


def updates_of(run: RunData) -> tuple[Any, ...]:
    """The updates of a run (`ibrid_policy.learning.updates`), none where nothing learns or that is not installed."""
    told = run.meta.get(UPDATES, "")
    if not told or find_spec("ibrid_policy") is None:
        return ()
    return policy_part("learning.updates").read_updates(told)


def learning_svg(updates: Sequence[Any]) -> str:
    """Reward, shares of answers, entropy and divergence; "" where there are no two updates."""
    if len(updates) < 2:
        return ""
    rewards: dict[str, Sequence[float | None]] = {
        "mean": [one.reward for one in updates],
        "best": [one.best_reward for one in updates],
    }
    if any(one.gain is not None for one in updates):
        rewards["gain, mean"] = [one.gain for one in updates]
    courses = (
        course("reward", rewards),
        course("share", {name.replace("duplicates", "known before"): [getattr(one, name) for one in updates]
                         for name in ("valid", "duplicates", "siblings", "refused")}),
        course("nats per token", {"entropy": [one.entropy for one in updates],
                                  "divergence": [one.divergence for one in updates]}),
    )  # fmt: skip
    label = (
        f"Reward, shares of answers, entropy and divergence over {len(updates)} updates; the tables give the numbers."
    )
    return inline_svg(
        lambda axes: draw_courses(axes, courses), name="learning", label=label, size=(11.5, 6.0), rows=len(courses)
    )
