"""A policy whose answers come from an OpenAI-compatible server, with log-probabilities, while a folder holds what is trained.

The server must give the log-probability of every token (`logprobs: true`; vLLM and SGLang do) and serve the same weights;
after each update they are written to a folder and handed over, and the probe of `search.learning.learner` proves it.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from search.context import prompt
from search.learning.adapters import merged
from search.learning.text_policy import TextPolicy
from search.policy.interface import Sampled
from search.proposal import Context
from search.proposers.chat import ChatError
from search.proposers.chat_request import Refusal, check_url, post


@dataclass(frozen=True)
class Server:
    """`model` : its name there. `url` : usually ends in /v1. `key` : "none" where it needs none. `timeout` : of an answer (s).

    `reload` : is given the folder of the new weights after every update and makes the server load them; None where nothing
    does, so that the probe will stop the training.
    """

    model: str
    url: str
    key: str = "none"
    timeout: float = 600.0
    reload: Callable[[Path], None] | None = None


class ServedPolicy(TextPolicy):
    """A `TextPolicy` that is sampled elsewhere. weights : folder into which the trained weights are written for the server."""

    def __init__(self, folder: str | Path, server: Server, weights: str | Path, **options: Any) -> None:
        super().__init__(folder, **options)
        check_url(server.url)
        if self.constrained:
            raise IbridError("answers of a server cannot be constrained; leave it out, or sample in this process")
        self.server, self.weights = server, Path(weights)

    def sample(
        self, prompts: Sequence[Sequence[int]], contexts: Sequence[Context], number: int, seed: int
    ) -> list[list[Sampled]]:
        """One request for each answer; ChatError when the server gives none, or none with log-probabilities."""
        return [[self._asked(one, seed + place) for place in range(number)] for one in contexts]

    def publish(self) -> None:
        """Write the weights and have the server load them."""
        if self.server.reload is not None:
            merged(self.model()).save_pretrained(self.weights)
            self.chat.tokenizer.save_pretrained(self.weights)
            self.server.reload(self.weights)

    def _asked(self, context: Context, seed: int) -> Sampled:
        most = min(self.prompt_tokens, self.chat.room - self.longest)
        body = {
            "model": self.server.model,
            "messages": prompt(context, limit_tokens=most - 64, count=self.chat.tokens),
            "max_tokens": self.longest,
            "temperature": 1.0,
            "top_p": 1.0,
            "seed": seed % 2**31,
            "logprobs": True,
        }
        where = f"the model {self.server.model} at {self.server.url}"
        reply = post(self.server.url, self.server.key, body, self.server.timeout)
        if isinstance(reply, Refusal):
            raise ChatError(f"{where} {reply.sentence}")
        return self._read(reply, where)

    def _read(self, reply: bytes, where: str) -> Sampled:
        try:
            choice = json.loads(reply)["choices"][0]
            said = (choice.get("logprobs") or {}).get("content")
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            raise ChatError(f"{where} sent no chat completion; check the base URL, which usually ends in /v1") from None
        if not isinstance(said, list) or not said:
            raise ChatError(
                f"{where} returns no log-probabilities, without which nothing can be learnt; serve it with vLLM or SGLang, or "
                "train the folder alone"
            )
        return Sampled(tuple(self._token(one, where) for one in said), tuple(_logprob(one, where) for one in said))

    def _token(self, one: Any, where: str) -> int:
        text = one.get("token") if isinstance(one, Mapping) else None
        found = self._ids.get(text) if isinstance(text, str) else None
        if found is None:
            raise ChatError(
                f"{where} has a token {text!r:.40} that {self.chat.name} lacks; serve the model that is trained"
            )
        return found

    @cached_property
    def _ids(self) -> dict[str, int]:
        """Token by its text, as servers print it, or by its name in the vocabulary."""
        tokenizer = self.chat.tokenizer
        found = dict(tokenizer.get_vocab())
        for token in reversed(range(len(tokenizer))):
            found[tokenizer.decode([token])] = token
        return found


def _logprob(one: Any, where: str) -> float:
    found = one.get("logprob") if isinstance(one, Mapping) else None
    if isinstance(found, bool) or not isinstance(found, int | float) or not -1e4 < found <= 1e-3:
        raise ChatError(f"{where} gives a log-probability {found!r:.40}; it must be a number not above 0")
    return min(float(found), 0.0)
