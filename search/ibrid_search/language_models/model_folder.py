"""Models in folders of others: nothing in a folder runs, nothing is downloaded, weights are
safetensors alone.
"""

import importlib
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid_search.run.parsed import mapping_in

CONFIG = "config.json"


def pretrained(kind: str, folder: Path, **options: Any) -> Any:
    """What a class of transformers reads from a folder: the only call of its `from_pretrained` for
    folders of others.

    Raises IbridError as `require_model`, and what transformers raises for damaged files.
    """
    require_model(folder)
    if "ForCausalLM" in kind:  # tokenizers and configs would keep the word as a setting of theirs
        options["use_safetensors"] = True
    transformers = importlib.import_module("transformers")
    return getattr(transformers, kind).from_pretrained(
        folder, local_files_only=True, trust_remote_code=False, **options
    )


def damage() -> tuple[type[Exception], ...]:
    """What transformers raises for a folder whose files are damaged or contradict one another."""
    tensors = importlib.import_module("safetensors").SafetensorError
    config = importlib.import_module("huggingface_hub.errors").StrictDataclassError
    plain = (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RuntimeError,
        ZeroDivisionError,
        ImportError,
    )
    return (*plain, tensors, config)


def require_model(folder: Path) -> None:
    """Raise IbridError unless the folder holds a model of its own whose weights are plain
    numbers.
    """
    if not (folder / CONFIG).is_file():
        raise IbridError(
            f"{folder}: holds no model; give a folder with {CONFIG}, weights and tokenizer, as "
            "save_pretrained writes it"
        )
    if not any(folder.glob("*.safetensors")):
        raise IbridError(
            f"{folder}: its weights must be *.safetensors, since other formats can run code; save "
            "the model again with "
            "save_pretrained(folder)"
        )
    if (folder / "adapter_config.json").exists():
        raise IbridError(
            f"{folder}: holds an adapter, which names a model elsewhere; merge it with "
            "merge_and_unload() and save the whole"
        )
    if any(
        "/" in str(value) for key, value in _config(folder).items() if "attn_implementation" in key
    ):
        raise IbridError(
            f"{folder}: its {CONFIG} asks for a kernel from the network; take attn_implementation "
            "out"
        )


def _config(folder: Path) -> dict[str, Any]:
    try:
        return mapping_in((folder / CONFIG).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # transformers says what is wrong with it
