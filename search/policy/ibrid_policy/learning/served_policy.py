"""A policy whose answers come from an OpenAI-compatible server, with log-probabilities, while a
folder holds what is trained.

The server must give the log-probability of every token (`logprobs: true`; SGLang and vLLM do) and
serve the same weights; after each update they are written to a folder and handed over, and the
probe of `ibrid_policy.learning.learner` proves it.

The likelihood of an answer is that of the tokens that are reported. Where a server ends an answer
("finish_reason": "stop") without reporting the token that did, that token is no part of it: its
probability under the served weights is not known, and one made up would count as if it had been
drawn. What is lost is what an update says about when to end.
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from ibrid_search.chat.chat import ChatError
from ibrid_search.chat.chat_request import Refusal, check_url, post
from ibrid_search.chat.chat_server import without_key
from ibrid_search.language_models.context import prompt
from ibrid_search.proposal import Context, Proposal

from ibrid.errors import IbridError
from ibrid.writing import inside
from ibrid_policy.interface import Sampled
from ibrid_policy.learning.adapters import merged
from ibrid_policy.learning.reported_tokens import ReportedTokens
from ibrid_policy.learning.text_policy import TextPolicy

#: Requests that are under way at once; a server draws their answers side by side.
TOGETHER = 16
#: What not every server knows: nothing is cut off the distribution (some cut by default), and
#: tokens come as numbers.
EXTRAS = {"top_k": -1, "return_tokens_as_token_ids": True}


@dataclass(frozen=True)
class Server:
    """`model` : its name there. `url` : usually ends in /v1. `key` : "none" where it needs none.
    `timeout` : of an answer (s).

    `reload` : is given the folder of the weights at first and after every update, and makes the
    server load them (`ibrid_policy.learning.weights_reload`); None where nothing does, so that the
    probe will stop the training.
    """

    model: str
    url: str
    key: str = field(default="none", repr=False)
    timeout: float = 600.0
    reload: Callable[[Path], None] | None = None


class ServedPolicy(TextPolicy):
    """A `TextPolicy` that is sampled elsewhere.

    weights : folder into which the trained weights are written for the server.
    """

    def __init__(
        self, folder: str | Path, server: Server, weights: str | Path, **options: Any
    ) -> None:
        super().__init__(folder, **options)
        check_url(server.url)
        if self.constrained:
            raise IbridError(
                "answers of a server cannot be constrained; leave it out, or sample in this process"
            )
        self.server, self.weights = server, Path(weights)
        self._handed = server.reload is None  # whether the server was told which weights to serve
        self._extras = True  # until the server refuses them

    def sample(
        self, prompts: Sequence[Sequence[int]], contexts: Sequence[Context], number: int, seed: int
    ) -> list[list[Sampled]]:
        """One request for each answer, `TOGETHER` at once, in their order.

        Raises ChatError when the server gives no answer, one without log-probabilities, or does not
        load the weights.
        """
        if not self._handed:
            self._hand_over(self.chat.folder)
        return [self._answers(one, number, seed) for one in contexts]

    def publish(self) -> None:
        """Write the weights, adapters merged into them, and have the server load them."""
        if self.server.reload is not None:
            for file in self.weights.glob("*"):
                inside(self.weights, file.name)
            merged(self.model()).save_pretrained(self.weights)
            self.chat.tokenizer.save_pretrained(self.weights)
            self._hand_over(self.weights)

    def proposal(self, sampled: Sampled, context: Context) -> Proposal:
        """The blocks in the text.

        Whether an answer was cut is known by its length, since servers may not report its end.
        """
        found = super().proposal(sampled, context)
        if len(sampled.tokens) >= self.longest:
            return found
        return replace(
            found, usage={name: one for name, one in found.usage.items() if name != "cut"}
        )

    def _hand_over(self, folder: Path) -> None:
        if self.server.reload is not None:
            self.server.reload(folder)
        self._handed = True

    def _answers(self, context: Context, number: int, seed: int) -> list[Sampled]:
        """Answers to one question; the first alone, since it shows what the server knows."""
        most = min(self.prompt_tokens, self.chat.room - self.longest)
        body = {
            "model": self.server.model,
            "messages": prompt(context, limit_tokens=most - 64, count=self.chat.tokens),
            "max_tokens": self.longest,
            "temperature": 1.0,
            "top_p": 1.0,
            "logprobs": True,
        }
        ask = partial(self._asked, body)
        seeds = [(seed + place) % 2**31 for place in range(number)]
        with ThreadPoolExecutor(TOGETHER) as pool:
            replies = [ask(seeds[0]), *pool.map(ask, seeds[1:])]
        return [self._read(one) for one in replies]

    def _asked(self, body: dict[str, Any], seed: int) -> bytes:
        """The reply to one request; without what the server does not know when it refuses that."""
        server, plain = self.server, {**body, "seed": seed}
        extended = {**plain, **EXTRAS} if self._extras else plain
        reply = post(server.url, server.key, extended, server.timeout)
        if self._extras and isinstance(reply, Refusal) and not reply.again:
            reply = post(server.url, server.key, plain, server.timeout)
            self._extras = isinstance(reply, Refusal)
        if isinstance(reply, Refusal):
            raise ChatError(without_key(server.key, f"{self._where} {reply.sentence}"))
        return reply

    @property
    def _where(self) -> str:
        return f"the model {self.server.model} at {self.server.url}"

    def _read(self, reply: bytes) -> Sampled:
        try:
            choice = json.loads(reply)["choices"][0]
            said = (choice.get("logprobs") or {}).get("content")
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            raise ChatError(
                f"{self._where} sent no chat completion; check the base URL, which usually ends in "
                "/v1"
            ) from None
        if not isinstance(said, list) or not said:
            raise ChatError(
                f"{self._where} returns no log-probabilities, without which nothing can be learnt; "
                "serve it with SGLang or vLLM, "
                "or train the folder alone"
            )
        tokens = tuple(self._tokens.token(one, self._where) for one in said)
        if any(token in self.ends for token in tokens[:-1]):
            raise ChatError(
                f"{self._where} goes on behind the end of an answer; let it stop there (ignore_eos)"
            )
        return Sampled(tokens, tuple(_logprob(one, self._where) for one in said))

    @cached_property
    def _tokens(self) -> ReportedTokens:
        return ReportedTokens(self.chat.tokenizer, self.chat.name)


def _logprob(one: Any, where: str) -> float:
    found = one.get("logprob")
    if isinstance(found, bool) or not isinstance(found, int | float) or not -1e4 < found <= 1e-3:
        raise ChatError(
            f"{where} gives a log-probability {found!r:.40}; it must be a number not above 0"
        )
    return min(float(found), 0.0)
