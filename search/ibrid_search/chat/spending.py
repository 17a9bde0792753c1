"""What language models may cost a run, and what they have cost so far."""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from pathlib import Path
from threading import Event, Thread
from typing import Any

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import IbridError
from ibrid_search.chat.chat import ChatError
from ibrid_search.proposal import TakesPart
from ibrid_search.run.store import Store

#: Prices of a million tokens in and a million out, in whatever currency: one pair for all models,
#: or one for each.
Prices = Sequence[tuple[float, float]]
#: Refusals in a row that are equal, and useless answers, after which a server is not asked again.
EQUAL = 3
EMPTY = 10
#: Questions of a run, where nobody says another number: a model that talks uselessly was once asked
#: 600 times.
QUESTIONS = 200
_NUMBER = re.compile(r"(, [\d.,]+ times)|[\d.,]+")
_UNITS = {"questions": "questions", "tokens": "tokens", "cost": "of cost", "seconds": "s"}
#: Parts of a usage that those of language models have alone.
_OF_ANSWERS = {"model", "prompt_tokens", "completion_tokens", "cost"}
#: Parts of a usage that add up over answers.
_SUMMED = (
    "questions",
    "prompt_tokens",
    "completion_tokens",
    "thinking_tokens",
    "cost",
    "seconds",
    "retries",
)


@methods_take_kinds
@dataclass(frozen=True)
class Limits:
    """What a whole run may spend: tokens in and out together, thinking included; cost in the
    currency of the prices; seconds of waiting for answers; questions, those that are asked again
    included.
    """

    tokens: float = inf
    cost: float = inf
    seconds: float = inf
    questions: float = QUESTIONS

    def __post_init__(self) -> None:
        require_kinds(self)
        if not all(one > 0 for one in (self.tokens, self.cost, self.seconds, self.questions)):
            raise IbridError(
                "limits of questions, tokens, cost and seconds must be above zero; leave one out"
            )

    @property
    def words(self) -> str:
        """What may be spent, and how it is said otherwise."""
        tokens = f"{self.tokens:,.0f} tokens" if self.tokens < inf else "any number of tokens"
        cost = f"a cost of {self.cost:g}" if self.cost < inf else "any cost"
        return (
            f"at most {self.questions:,.0f} questions (--questions), {tokens} (--model-tokens) and "
            f"{cost} (--model-cost)"
        )


def without_numbers(sentence: str) -> str:
    """What two complaints have in common that differ in times and counts."""
    return _NUMBER.sub("", sentence)


class Spending:
    """Counts usage against `limits`; a run that resumes counts that of the steps in its store
    first.
    """

    def __init__(self, limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self.spent: dict[str, float] = dict.fromkeys(_UNITS, 0.0)

    def count(self, usage: Mapping[str, Any]) -> None:
        """Add the usage of an answer, or of a whole step; one that does not say how often it asked
        did so once.
        """
        self.spent["questions"] += _number(
            usage.get("questions", not _OF_ANSWERS.isdisjoint(usage))
        )
        for name in ("prompt_tokens", "completion_tokens", "cost", "seconds"):
            self.spent["tokens" if name.endswith("tokens") else name] += _number(usage.get(name, 0))

    @property
    def over(self) -> str:
        """The sentence that says which limit is spent; "" when none is."""
        for name, unit in _UNITS.items():
            limit = getattr(self.limits, name)
            if self.spent[name] >= limit:
                return (
                    f"the limit of {limit:g} {unit} of this run is spent; raise it or use another "
                    "proposer"
                )
        return ""

    @property
    def seconds_left(self) -> float:
        """Of waiting for answers."""
        return max(self.limits.seconds - self.spent["seconds"], 0.0)

    @property
    def questions_left(self) -> float:
        """Of those that may be asked, those asked again included."""
        return max(self.limits.questions - self.spent["questions"], 0.0)

    @property
    def words(self) -> str:
        """What is spent, in a few words."""
        return spent_words(self.spent)


class Spender(TakesPart):
    """A proposer that asks models.

    `spending` : theirs in this run; over its limits the proposer answers no more.
    """

    name: str
    spending: Spending
    _why, _times, _most = "", 0, EQUAL
    _store: Store | None = None
    _asked = 0.0

    def begin(self, store: Store, folder: Path) -> None:
        """Count what was spent in earlier sittings, and the question that was asked when one was
        stopped.
        """
        for step in store.steps():
            if step.proposer == self.name:
                self.count(step.usage)
        self._store, begun = store, store.meta.get(self._begun, "")
        if begun.isdecimal() and float(begun) > self._asked:
            self.count({"questions": float(begun) - self._asked})

    def count(self, usage: Mapping[str, Any]) -> None:
        """Add the usage of an answer to what is spent."""
        before = self.spending.spent["questions"]
        self.spending.count(usage)
        self._asked += self.spending.spent["questions"] - before

    @property
    def _begun(self) -> str:
        """Under which the store says how many questions were asked, that under way included."""
        return f"questions of {self.name}"

    def sent(self, requests: int) -> None:
        """Note how often the question under way was asked: a sitting that is stopped now counts it,
        too.
        """
        if self._store is not None:
            self._store.set_meta(self._begun, f"{self._asked + requests:.0f}")

    @property
    def terms(self) -> str:
        """What this proposer may spend, as a sentence before it begins."""
        most, asked = self.tokens_of_a_question, self.spending.limits.questions
        about = (
            f"; a question and its answer take up to about {most:,} tokens, all of them "
            f"{most * asked:,.0f}"
        )
        return (
            f"The proposer {self.name} takes {self.spending.limits.words} in this "
            f"run{about if most else ''}."
        )

    @property
    def tokens_of_a_question(self) -> int:
        """Tokens of the longest question and the longest answer to it, 0 where nobody knows."""
        return 0

    @property
    def exhausted(self) -> bool:
        """True when a limit is spent."""
        return bool(self.spending.over)

    @property
    def broken(self) -> str:
        """What a server has said to some questions in a row, each time the same; "" while it
        answers.
        """
        return self._why if self._times >= self._most else ""

    @contextmanager
    def asking(self, name: str) -> Iterator[None]:
        """While a model is asked: says so every second, and counts refusals that are equal but for
        their numbers.
        """
        over, began = Event(), time.monotonic()

        def say() -> None:
            while not over.wait(1.0):
                spent = f"; {words} so far" if (words := self.spending.words) else ""
                self.tell(f"{name} thinks, {time.monotonic() - began:.0f} s{spent}")

        self.sent(1)
        thread = Thread(target=say, daemon=True)
        thread.start()
        try:
            yield
        except ChatError as error:
            self.complain(str(error), EQUAL)
            raise
        finally:
            over.set()
            thread.join()

    def complain(self, why: str, most: int = EMPTY) -> None:
        """Count a question without an answer that can be used; "" for one that has one.

        most : in a row that are borne.
        """
        same = why and without_numbers(why) == without_numbers(self._why)
        self._times = 0 if not why else self._times + 1 if same else 1
        self._why, self._most = why, most


def spent_words(spent: Mapping[str, float]) -> str:
    """Tokens, and their cost where they have a price; "" when no model was asked."""
    tokens, cost = spent["tokens"], spent["cost"]
    return (f"{tokens:,.0f} tokens" if tokens else "") + (f", cost {cost:.3g}" if cost else "")


def added(before: Mapping[str, Any], usage: Mapping[str, Any]) -> dict[str, Any]:
    """The usage of several answers together: counts, times and costs add up, the rest is that of
    the last.
    """
    known = [name for name in _SUMMED if name in before or name in usage]
    return {
        **usage,
        **{name: _number(before.get(name, 0)) + _number(usage.get(name, 0)) for name in known},
    }


def _number(value: Any) -> float:
    """A count of a model that somebody else wrote; what makes no sense is none."""
    return value if isinstance(value, int | float) and 0 <= value < inf else 0
