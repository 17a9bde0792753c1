"""Low-rank adapters (LoRA) in place of training everything; the package peft does it, when it is installed."""

import importlib
from typing import Any

from ibrid.errors import IbridError


def add_adapters(model: Any, rank: int, seed: int) -> None:
    """Put adapters of this rank beside every linear layer, in place, and let nothing else be trained.

    They begin as nothing: the model says what it said before. Raises IbridError when peft is not installed.
    """
    import torch  # pyright: ignore[reportMissingImports]

    peft = require_peft()
    layers = {name.rpartition(".")[2] for name, one in model.named_modules() if isinstance(one, torch.nn.Linear)}
    with torch.random.fork_rng():
        torch.manual_seed(seed)  # before the adapters are drawn
        wanted = peft.LoraConfig(r=rank, lora_alpha=2 * rank, target_modules=sorted(layers - {"lm_head"}))
        peft.inject_adapter_in_model(wanted, model)
    for name, one in model.named_parameters():
        one.requires_grad_("lora_" in name)


def require_peft() -> Any:
    """The package peft; IbridError when it is not installed."""
    try:
        return importlib.import_module("peft")
    except ImportError:
        raise IbridError(
            "low-rank adapters need the package peft; pip install 'ibrid[lora]', or leave the rank at 0 to train all weights"
        ) from None
