"""The files of a policy: config.json, model.safetensors, vocabulary.json and MODEL_CARD.md in one
folder.
"""

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ibrid_search.language_models.model_folder import damage, pretrained

from ibrid.errors import IbridError
from ibrid.writing import write_whole
from ibrid_policy.backend import require
from ibrid_policy.tokens import END, PAD, TOKENS

CONFIG_FILE, WEIGHTS_FILE = "config.json", "model.safetensors"
VOCABULARY_FILE, CARD = "vocabulary.json", "MODEL_CARD.md"
#: The shipped model, of 1.1 million parameters; and one of 5 million, which takes more data and,
#: without a GPU, hours.
SIZES: Mapping[str, Mapping[str, int]] = MappingProxyType(
    {
        "small": {
            "hidden_size": 128,
            "intermediate_size": 352,
            "num_hidden_layers": 5,
            "num_attention_heads": 4,
        },
        "large": {
            "hidden_size": 256,
            "intermediate_size": 704,
            "num_hidden_layers": 6,
            "num_attention_heads": 8,
        },
    }
)
LONGEST_SEQUENCE = 1024


def shipped_folder() -> Path:
    """The weights that come with the package."""
    return Path(str(files("ibrid_policy") / "weights"))


def new_model(seed: int, sizes: Mapping[str, int]) -> Any:
    """An untrained causal language model over the tokens of the policy, float32."""
    torch, transformers = require("torch"), require("transformers")
    config = transformers.LlamaConfig(
        vocab_size=len(TOKENS),
        **sizes,
        num_key_value_heads=sizes["num_attention_heads"],
        max_position_embeddings=LONGEST_SEQUENCE,
        tie_word_embeddings=True,
        pad_token_id=TOKENS.ids[PAD],
        bos_token_id=None,
        eos_token_id=TOKENS.ids[END],
    )
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return transformers.LlamaForCausalLM(config).float()


def require_weights(folder: Path) -> None:
    """Raise IbridError unless the folder holds a policy."""
    if not all((folder / name).is_file() for name in (CONFIG_FILE, WEIGHTS_FILE, VOCABULARY_FILE)):
        raise IbridError(f"{folder}: holds no policy; make one with ibrid policy train --out DIR")


def load_model(folder: Path) -> Any:
    """The model of a folder, float32, on the CPU.

    Raises IbridError when there is none, it speaks another language, or its weights are damaged or
    not all there.
    """
    require_weights(folder)
    torch, transformers = require("torch"), require("transformers")
    transformers.utils.logging.disable_progress_bar()
    try:
        words = json.loads((folder / VOCABULARY_FILE).read_text(encoding="utf-8"))
        if words != list(TOKENS.words):
            raise IbridError(
                f"{folder}: its weights belong to other tokens than this version's; train again"
            )
        _require_whole(folder)
        model = pretrained("LlamaForCausalLM", folder, dtype=torch.float32)
    except IbridError:
        raise
    except damage() as error:
        raise IbridError(
            f"{folder}: cannot be loaded ({' '.join(str(error).split())[:200]}); train again"
        ) from None
    for name, value in model.named_parameters():
        if not torch.isfinite(value).all():
            raise IbridError(
                f"{folder}: its weights must be finite numbers, {name} has others; train again"
            )
    return model


def _require_whole(folder: Path) -> None:
    """Raise IbridError unless every weight that the config asks for is there; transformers would
    draw what is missing.
    """
    torch, transformers = require("torch"), require("transformers")
    with torch.device("meta"):
        wanted = transformers.LlamaForCausalLM(pretrained("LlamaConfig", folder))
    with require("safetensors").safe_open(folder / WEIGHTS_FILE, framework="pt") as file:
        there = {name: list(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118 (no mapping)
    for name, value in wanted.named_parameters():
        if there.get(name) != list(value.shape):
            raise IbridError(
                f"{folder}: {name} must be {list(value.shape)} numbers as {CONFIG_FILE} says, "
                "found "
                f"{there.get(name, 'none')}; train again"
            )


def save_model(model: Any, folder: Path, card: str) -> None:
    """Write the weights as 16-bit numbers, with the tokens and the card."""
    torch = require("torch")
    require("transformers").utils.logging.disable_progress_bar()
    folder.mkdir(parents=True, exist_ok=True)
    half = {
        name: value.detach().to("cpu", torch.float16) for name, value in model.state_dict().items()
    }
    model.save_pretrained(folder, state_dict=half, safe_serialization=True)
    (folder / "generation_config.json").unlink(missing_ok=True)
    (folder / WEIGHTS_FILE).chmod(0o644)  # written for its owner alone
    write_whole(folder / VOCABULARY_FILE, json.dumps(list(TOKENS.words), indent=0) + "\n")
    write_whole(folder / CARD, card)
