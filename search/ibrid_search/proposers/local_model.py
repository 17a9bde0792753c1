"""A language model in a folder on this machine, run by transformers; nothing is downloaded and no
code of the folder runs.
"""

import importlib
import importlib.util
import json
import os
import time
from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid_search.chat.chat import LONGEST_ANSWER, Answer, ChatError, Message, prompt_text
from ibrid_search.language_models.model_folder import damage, pretrained, require_model

#: Parameters of a model below which a CPU computes in single precision: half precision is emulated
#: there, many times slower.
SMALL = 1_000_000_000


class LocalModel:
    """A model saved with `save_pretrained`: weights, config and tokenizer in one folder.

    `max_tokens`, `seconds` : where an answer ends at the latest. `temperature`, `top_p` : of the
    sampling, which is seeded by `rng_seed`, so an answer repeats on one machine. `threads` : of
    torch on the CPU, by default half the cores, so that evaluations beside it keep running; a GPU
    that torch finds is used. With the package llguidance answers can be held to a JSON schema
    (`fill`).

    Raises IbridError when the folder holds no model, or weights that can run code.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        max_tokens: int = 2_048,
        seconds: float = 600.0,
        temperature: float = 1.0,
        top_p: float = 1.0,
        threads: int | None = None,
    ) -> None:
        self.folder = Path(folder).expanduser()
        require_model(self.folder)
        if max_tokens < 1 or not seconds > 0 or not temperature > 0 or not 0 < top_p <= 1:
            raise IbridError(
                "a local model needs max_tokens, seconds and temperature above zero and top_p "
                "within (0, 1]; "
                "leave them out for the defaults"
            )
        self.max_tokens, self.seconds = max_tokens, seconds
        self.temperature, self.top_p = temperature, top_p
        self.threads = threads or max(1, (os.cpu_count() or 2) // 2)

    def __getstate__(self) -> dict[str, Any]:
        """Without what was loaded: a copy reads the folder itself, so that nobody trains the
        weights of another.
        """
        return {
            k: v
            for k, v in vars(self).items()
            if not isinstance(getattr(type(self), k, None), cached_property)
        }

    def bounded(self, seconds: float, questions: float = inf, sent: object = None) -> "LocalModel":
        """The same, with less time for an answer where that is less; what is loaded is shared.

        It is never asked again.
        """
        if seconds >= self.seconds:
            return self
        shorter = copy(self)
        vars(shorter).update(vars(self), _loaded=self._loaded, seconds=max(seconds, 0.1))
        return shorter

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.resolve().name

    def complete(
        self,
        messages: Sequence[Message],
        *,
        tools: Sequence[Mapping[str, Any]] | None = None,
        rng_seed: int = 0,
    ) -> Answer:
        """The next turn; see `ibrid_search.proposers.chat.Chat`.

        Tools are left out: their call has no common form.
        """
        return self._answer(messages, rng_seed)

    @property
    def asked_form(self) -> str:
        """How an answer is held to the fields of an edit, in the words of
        `ibrid_search.chat.answer_forms`.
        """
        return (
            "schema"
            if importlib.util.find_spec("llguidance") and self._loaded[2].is_fast
            else "text"
        )

    def fill(
        self, messages: Sequence[Message], schema: Mapping[str, Any], form: str, rng_seed: int = 0
    ) -> Answer:
        """The next turn as JSON that follows a schema: tokens that would leave it are never
        drawn.
        """
        return self._answer(messages, rng_seed, schema)

    def _answer(
        self, messages: Sequence[Message], rng_seed: int, schema: Mapping[str, Any] | None = None
    ) -> Answer:
        started = time.monotonic()
        _, model, tokenizer = self._loaded
        prompt = tokenizer(
            self._templated(tokenizer, messages), return_tensors="pt", add_special_tokens=False
        )
        number = int(prompt["input_ids"].shape[1])
        room = getattr(model.config, "max_position_embeddings", None)
        if room is not None and number >= room:
            raise ChatError(
                f"the prompt has {number} tokens, but {self.name} reads {room}; lower the token "
                "limit"
            )
        most = self.max_tokens if room is None else min(self.max_tokens, room - number)
        new = self._generated(prompt, most, rng_seed, schema)[number:]
        usage = {
            "model": self.name,
            "questions": 1,
            "prompt_tokens": number,
            "completion_tokens": len(new),
            "cost": 0.0,
            "seconds": time.monotonic() - started,
            "retries": 0,
        }
        ends = model.generation_config.eos_token_id
        cut = not new or new[-1] not in (ends if isinstance(ends, list) else [ends])
        return Answer(
            tokenizer.decode(new, skip_special_tokens=True)[:LONGEST_ANSWER], usage=usage, cut=cut
        )

    def tokens(self, text: str) -> int:
        """Number of tokens of a text."""
        return len(self._loaded[2](text, add_special_tokens=False)["input_ids"])

    def _generated(
        self, prompt: Any, most: int, seed: int, schema: Mapping[str, Any] | None
    ) -> list[int]:
        """Prompt and answer as tokens; the state of torch's random numbers and its threads stay as
        they were.
        """
        torch, model, tokenizer = self._loaded
        padding = (
            tokenizer.pad_token_id if tokenizer.pad_token_id is not None else tokenizer.eos_token_id
        )
        threads = torch.get_num_threads()
        torch.set_num_threads(self.threads)
        try:
            ends, begins = model.generation_config.eos_token_id, prompt["input_ids"].shape[1]
            held = None if schema is None else [_Held(tokenizer, schema, ends, begins)]
            with torch.random.fork_rng(), torch.inference_mode():
                torch.manual_seed(seed)
                sequences = model.generate(
                    **prompt.to(model.device),
                    do_sample=True,
                    temperature=self.temperature,
                    top_p=self.top_p,
                    top_k=0,
                    max_new_tokens=most,
                    max_time=self.seconds,
                    pad_token_id=padding,
                    logits_processor=held,
                )
        except (
            RuntimeError,
            ValueError,
        ) as error:  # no memory, probabilities that are no numbers, no such grammar
            raise ChatError(
                f"{self.name} broke off ({' '.join(str(error).split())[:200]})"
            ) from None
        finally:
            torch.set_num_threads(threads)
        return sequences[0].tolist()

    @cached_property
    def _loaded(self) -> tuple[Any, Any, Any]:
        torch, transformers = _require("torch"), _require("transformers")
        transformers.utils.logging.disable_progress_bar()  # the search shows its own
        try:
            tokenizer = pretrained("AutoTokenizer", self.folder)
            model = pretrained("AutoModelForCausalLM", self.folder, dtype="auto")
        except damage() as error:
            raise ChatError(
                f"{self.folder}: cannot be loaded ({' '.join(str(error).split())[:200]})"
            ) from None
        if not torch.cuda.is_available() and model.num_parameters() < SMALL:
            model = model.float()
        return torch, model.eval().to("cuda" if torch.cuda.is_available() else "cpu"), tokenizer

    def _templated(self, tokenizer: Any, messages: Sequence[Message]) -> str:
        """The conversation in the model's own form; models without a system turn get it in front of
        the first question.
        """
        if tokenizer.chat_template is None:
            return prompt_text(messages) + "\n\nassistant:"
        plain = [{"role": one["role"], "content": one.get("content") or ""} for one in messages]
        errors = _require("jinja2").exceptions.TemplateError
        for conversation in (plain, _without_system(plain)):
            try:
                return tokenizer.apply_chat_template(
                    conversation, tokenize=False, add_generation_prompt=True
                )
            except errors as error:
                reason = error
        raise ChatError(
            f"the template of {self.name} takes no such conversation ({str(reason)[:200]})"
        )


class _Held:
    """A logits processor that holds one answer to a JSON schema.

    `ends` : tokens that end it. `begins` : tokens before it.
    """

    def __init__(self, tokenizer: Any, schema: Mapping[str, Any], ends: Any, begins: int) -> None:
        guidance = _require("llguidance")
        compact = json.dumps({**schema, "x-guidance": {"whitespace_flexible": False}})
        words = _require("llguidance.hf").from_tokenizer(tokenizer, eos_token=ends)
        self.matcher, self.taken = (
            guidance.LLMatcher(words, guidance.grammar_from("json_schema", compact)),
            begins,
        )

    def __call__(self, tokens: Any, scores: Any) -> Any:
        new = tokens[0, self.taken :].tolist()
        self.taken += len(new)
        if not self.matcher.consume_tokens(new) or self.matcher.is_error():
            raise ValueError(f"no answer follows the schema: {self.matcher.get_error()}")
        allowed = np.frombuffer(self.matcher.compute_logit_bias(), np.uint8)
        kept = np.flatnonzero(
            allowed[: scores.shape[-1]]
        )  # models have more scores than their tokenizer has words
        held = scores.new_full(scores.shape, -inf)
        held[:, kept] = scores[:, kept]
        return held


def _without_system(messages: Sequence[Message]) -> list[dict[str, str]]:
    system = "\n\n".join(one["content"] for one in messages if one["role"] == "system")
    rest = [dict(one) for one in messages if one["role"] != "system"]
    if system and rest:
        rest[0]["content"] = f"{system}\n\n{rest[0]['content']}"
    return rest


def _require(package: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError:
        raise ChatError(
            f"a local model needs the package {package}; pip install 'ibrid[local-llm]', after a "
            "build of torch for this machine"
        ) from None
