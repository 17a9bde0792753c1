"""Language models by name, as a command line gives them: MODEL, MODEL@URL or a folder, each with an
optional weight.
"""

import re
from collections.abc import Sequence
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid_search.chat.chat import Chat
from ibrid_search.chat.chat_request import LITELLM
from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.chat.spending import Prices
from ibrid_search.proposers.local_model import LocalModel

_WEIGHT = re.compile(r"(.*)\*([0-9.eE+-]{1,20})", re.DOTALL)
_KEY = re.compile(r"(.*)\?key=([A-Za-z_][A-Za-z0-9_]{0,99})", re.DOTALL)


def model_of(option: str, **settings: Any) -> tuple[Chat, float]:
    """A model and its weight (1 when none is given).

    "gpt-x@http://127.0.0.1:8123/v1*0.7" is model gpt-x of that server; "gpt-x" alone one of the
    server that the environment names; "litellm:vendor/model" one that the package litellm finds;
    "?key=NAME" behind the URL takes the key from another variable than OPENAI_API_KEY; an existing
    folder, or a path such as ./models/small, is a model on this machine. `settings` go to
    ChatServer, max_tokens and temperature to a local model too.

    Raises IbridError, also when the package that the model needs is not installed.
    """
    name, weight = _weight(option)
    where = re.search(r"@https?://", name)
    if where is None and (
        (name and Path(name).expanduser().is_dir()) or name.startswith(("/", "./", "../", "~"))
    ):
        own = {
            name: value for name, value in settings.items() if name in ("max_tokens", "temperature")
        }
        model = LocalModel(name, **own)
        _require("local-llm", "torch", "transformers")
        return model, weight
    url = None
    if where is not None:
        name, url = name[: where.start()], name[where.start() + 1 :]
        if (found := _KEY.fullmatch(url)) is not None:
            url, settings = found[1], {**settings, "key_from": found[2]}
    if url is None and name.startswith(f"{LITELLM}:"):
        name, url = name.removeprefix(f"{LITELLM}:"), LITELLM
    if not name.strip() or "://" in name:
        raise IbridError(
            "a language model is written MODEL, MODEL@http://host:port/v1 or as a folder, each "
            "with *WEIGHT if it has "
            f"one, found {option!r:.80}; name the model"
        )
    _require("llm", "openai")
    return ChatServer(name.strip(), url, **settings), weight


def models_of(
    options: Sequence[str], prices: Prices = (), **settings: Any
) -> list[tuple[Chat, float]]:
    """Models with their weights, each as `model_of` reads it; those on this machine cost nothing.

    Raises IbridError for a number of prices that is neither one nor that of the models, and what
    `model_of` raises.
    """
    if len(prices) not in (0, 1, len(options)):
        raise IbridError(
            f"{len(options)} models need one price for all or one for each, found {len(prices)}; "
            "give --model-price once, "
            "or as often as --model"
        )
    if not prices:
        return [model_of(one, **settings) for one in options]
    each = prices if len(prices) == len(options) else [prices[0]] * len(options)
    return [
        model_of(one, price=tuple(price), **settings)
        for one, price in zip(options, each, strict=True)
    ]


def _weight(option: str) -> tuple[str, float]:
    match = _WEIGHT.fullmatch(option.strip())
    if match is None:
        return option.strip(), 1.0
    try:
        weight = float(match[2])
    except ValueError:
        weight = -1.0
    if not isfinite(weight) or weight < 0:
        raise IbridError(
            f"the weight of a language model is a number not below zero, found {match[2]!r}; write "
            "*0.7"
        )
    return match[1], weight


def _require(extra: str, *packages: str) -> None:
    for package in packages:
        if find_spec(package) is None:
            raise IbridError(
                f"this language model needs the package {package}; pip install 'ibrid[{extra}]'"
            )
