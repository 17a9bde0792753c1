"""Tiny causal language models of many kinds with random weights, for tests."""

from typing import Any

#: Tokens of all of them.
TOKENS = 19
#: By name: the kind of config of transformers, what it asks for besides the sizes, and whether
#: answers may stand side by side.
KINDS: dict[str, tuple[str, dict[str, Any], bool]] = {
    "llama": ("LlamaConfig", {}, True),
    "qwen2": ("Qwen2Config", {}, True),
    "qwen3": ("Qwen3Config", {"head_dim": 8}, True),
    "phi3": ("Phi3Config", {"pad_token_id": 0}, True),
    "gpt2": ("GPT2Config", {}, True),
    "neox": ("GPTNeoXConfig", {}, True),
    "opt": ("OPTConfig", {"ffn_dim": 32, "word_embed_proj_dim": 16, "pad_token_id": 0}, True),
    "mistral without a window": ("MistralConfig", {"sliding_window": None}, True),
    "mistral": ("MistralConfig", {"sliding_window": 4}, False),
    "qwen2 with windows": (
        "Qwen2Config",
        {"use_sliding_window": True, "sliding_window": 4, "max_window_layers": 1},
        False,
    ),
    "gemma2": ("Gemma2Config", {"sliding_window": 4, "head_dim": 8}, False),
    "gemma3": ("Gemma3TextConfig", {"sliding_window": 4, "head_dim": 8}, False),
    "bloom": ("BloomConfig", {"n_head": 2, "n_layer": 2}, False),
    "falcon": (
        "FalconConfig",
        {"alibi": True, "new_decoder_architecture": False, "multi_query": False},
        False,
    ),
    "mpt": ("MptConfig", {"d_model": 16, "n_heads": 2, "n_layers": 2, "expansion_ratio": 2}, False),
    "mixtral": ("MixtralConfig", {"num_local_experts": 4, "sliding_window": 4}, False),
    "mamba": ("MambaConfig", {"state_size": 4}, False),
    "mamba2": (
        "Mamba2Config",
        {"state_size": 4, "num_heads": 4, "head_dim": 8, "n_groups": 1, "chunk_size": 4},
        False,
    ),
}


def made(name: str) -> Any:
    """The model of a name, float32, two layers of 16 numbers; its answers depend on every token
    before.
    """
    import torch  # pyright: ignore[reportMissingImports]
    import transformers  # pyright: ignore[reportMissingImports]

    config, own, _ = KINDS[name]
    sizes = {
        "vocab_size": TOKENS,
        "hidden_size": 16,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "num_key_value_heads": 2,
        "max_position_embeddings": 128,
        "initializer_range": 0.3,
        "bos_token_id": None,
        "eos_token_id": 0,
    }
    with torch.random.fork_rng():
        torch.manual_seed(0)
        made_of = getattr(transformers, config)(**sizes | own)
        return transformers.AutoModelForCausalLM.from_config(made_of, dtype=torch.float32).eval()
