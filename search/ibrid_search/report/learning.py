"""The section about learning: each update with its batch, as figures and as a table, and what was wrong."""

from collections.abc import Sequence

from ibrid_policy.learning.updates import META, Update, read_updates

from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.learning import course, draw_courses
from ibrid.report.markup import bullets, cell, folded, head, paragraph, table, value_cell
from ibrid.report.numbers import percent, seconds
from ibrid_search.report.run_data import RunData

_SHARES = ("valid", "unchanged", "duplicates", "siblings", "refused", "failed")
_WORDS = (
    "An update makes the better answers of a batch more likely: those of higher reward among the answers to the same question, "
    "or, where a gain is told, those that gain most on the candidate they edit. Valid: fitted or, where first looks judge, "
    "looked at, repetitions within the batch included. Known before: duplicates of structures older than the batch; siblings: "
    "answers that repeat another of their batch. Divergence: how far the policy is from the one that the search began with, in "
    "nats per token (KL). Entropy: how undecided it is, in nats per token."
)
_EXACT = (
    "Importance weight: what training and sampling think of the same token, 1 when they agree; drift: the mean difference of "
    "their log-probabilities, in the batch and in a probe after the update; handed over: how much of the update the weights that "
    "answer the probe have, 100 % when they are the trained ones. Clipped: tokens whose gradient was cut off."
)


def updates_of(run: RunData) -> tuple[Update, ...]:
    """The updates of a run, none where nothing learns."""
    return read_updates(run.meta.get(META, ""))


def learning_html(run: RunData) -> str:
    """Figures and tables; "" for a run without an update."""
    updates = updates_of(run)
    if not updates:
        return ""
    remarks = [f"Update {one.number}: {one.remark}." for one in updates if one.remark]
    return (
        paragraph(_WORDS, "note")
        + _figure(updates)
        + _batches(updates)
        + bullets(remarks) * bool(remarks)
        + _steps(updates)
    )


def _figure(updates: Sequence[Update]) -> str:
    if len(updates) < 2:
        return ""
    rewards: dict[str, Sequence[float | None]] = {
        "mean": [one.reward for one in updates],
        "best": [one.best_reward for one in updates],
    }
    if _gains(updates):
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
    svg = inline_svg(
        lambda axes: draw_courses(axes, courses), name="learning", label=label, size=(11.5, 6.0), rows=len(courses)
    )
    return figure_html(svg, style="broad")


def _gains(updates: Sequence[Update]) -> bool:
    return any(one.gain is not None for one in updates)


def _batches(updates: Sequence[Update]) -> str:
    names = ["update", "steps", "reward, mean", "best", *["gain, mean"] * _gains(updates), "valid", "unchanged",
             "known before", "siblings", "refused", "failed", "lost", "tokens"]  # fmt: skip
    rows = "".join(
        f'<tr><th scope="row" class="n">{one.number}</th>'
        + cell(f"{one.first} to {one.last}")
        + value_cell(one.reward)
        + value_cell(one.best_reward)
        + value_cell(one.gain) * _gains(updates)
        + "".join(cell(percent(getattr(one, name)), numeric=True) for name in _SHARES)
        + cell(str(one.lost), numeric=True)
        + cell(f"{one.tokens:.0f}", numeric=True)
        + "</tr>"
        for one in updates
    )
    body = head(names, numeric=(0, *range(2, len(names)))) + f"<tbody>{rows}</tbody>"
    return table("Updates", "What the answers of each batch came to.", body)


def _steps(updates: Sequence[Update]) -> str:
    names = ["update", "questions dropped", "entropy", "divergence", "weight", "largest", "clipped", "drift", "probe",
             "handed over", "gradient", "sampling", "update took"]  # fmt: skip
    rows = "".join(
        f'<tr><th scope="row" class="n">{one.number}</th>'
        + cell(str(one.dropped), numeric=True)
        + "".join(value_cell(found, 3) for found in (one.entropy, one.divergence, one.weight, one.largest_weight))
        + cell("" if one.clipped is None else percent(one.clipped), numeric=True)
        + "".join(value_cell(found, 2) for found in (one.drift, one.probe))
        + cell("" if one.handed is None else percent(one.handed), numeric=True)
        + value_cell(one.gradient, 2)
        + cell(seconds(one.seconds_sampling), numeric=True)
        + cell(seconds(one.seconds_update), numeric=True)
        + "</tr>"
        for one in updates
    )
    body = head(names, numeric=range(len(names))) + f"<tbody>{rows}</tbody>"
    return folded("Each update in numbers", table("Steps of the weights", _EXACT, body))
