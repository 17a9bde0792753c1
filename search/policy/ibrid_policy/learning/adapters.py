"""Low-rank adapters (LoRA) in place of training everything; the package peft does it, when it is
installed.
"""

import copy
import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from ibrid.errors import IbridError


def add_adapters(model: Any, rank: int, seed: int) -> None:
    """Put adapters of this rank beside every linear layer, in place, and let nothing else be
    trained.

    They begin as nothing: the model says what it said before. Raises IbridError when peft is not
    installed, and what `require_rank` raises.
    """
    import torch  # pyright: ignore[reportMissingImports]

    peft = require_peft()
    require_rank(model, rank)
    layers = {name.rpartition(".")[2] for name in _layers(model)}
    with torch.random.fork_rng():
        torch.manual_seed(seed)  # before the adapters are drawn
        wanted = peft.LoraConfig(r=rank, lora_alpha=2 * rank, target_modules=sorted(layers))
        peft.inject_adapter_in_model(wanted, model)
    for name, one in model.named_parameters():
        one.requires_grad_("lora_" in name)


@contextmanager
def without_adapters(model: Any) -> Iterator[None]:
    """Within, the model says what it said before it was given adapters."""
    from peft.tuners.tuners_utils import BaseTunerLayer  # pyright: ignore[reportMissingImports]

    layers = [one for one in model.modules() if isinstance(one, BaseTunerLayer)]
    for one in layers:
        one.enable_adapters(False)
    try:
        yield
    finally:
        for one in layers:
            one.enable_adapters(True)


def merged(model: Any) -> Any:
    """A copy in which the adapters are part of the weights; a copy as it is of a model without
    adapters.
    """
    model = copy.deepcopy(model)
    for name, one in list(model.named_modules()):
        if hasattr(one, "lora_A"):
            one.merge()
            above, _, own = name.rpartition(".")
            setattr(model.get_submodule(above), own, one.get_base_layer())
    return model


def require_rank(model: Any, rank: int) -> None:
    """Raise IbridError unless the model has layers for adapters, one of them at least as wide as
    their rank.
    """
    widest = max((min(one.weight.shape) for one in _layers(model).values()), default=0)
    if not widest:
        raise IbridError(
            f"a {type(model).__name__} has no linear layers for adapters; train all weights, with "
            "rank 0"
        )
    if rank > widest:
        raise IbridError(
            f"adapters of rank {rank} are wider than every layer of the model; give a rank of "
            f"{widest} or less, such as 16"
        )


def _layers(model: Any) -> Mapping[str, Any]:
    """The linear layers by name, but for the last one, which says the tokens."""
    import torch  # pyright: ignore[reportMissingImports]
    from transformers.pytorch_utils import Conv1D  # pyright: ignore[reportMissingImports]

    last = model.get_output_embeddings()
    linear = {
        name: one
        for name, one in model.named_modules()
        if isinstance(one, torch.nn.Linear | Conv1D)
    }
    return {name: one for name, one in linear.items() if one is not last}


def require_peft() -> Any:
    """The package peft; IbridError when it is not installed."""
    try:
        return importlib.import_module("peft")
    except ImportError:
        raise IbridError(
            "low-rank adapters need the package peft; pip install 'ibrid[lora]', or leave the rank "
            "at 0 to train all weights"
        ) from None
