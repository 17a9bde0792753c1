"""A small language model of whole edits behind an HTTP server on loopback that samples, tells
log-probabilities and loads weights from a folder, as SGLang does.
"""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ibrid_search.chat.chat import prompt_text
from ibrid_search.language_models.context import system_text
from scripted_search import study
from scripted_server import Handler, scripted

KINDS = ("PI_dq", "LPF1_dq", "Gain_dq", "Pade1_dq")
LINE = '    g.connect("gain.out", "plant.u_r")'
NEW = (
    '    g.add("{kind}", "new")\n    g.connect("gain.out", "new.in_")\n    g.connect("new.out", '
    '"plant.u_r")'
)
#: One token each: edits of the naive program, and something else.
EDITS = (
    *(
        f"<<<<<<< SEARCH\n{LINE}\n=======\n{NEW.format(kind=kind)}\n>>>>>>> REPLACE"
        for kind in KINDS
    ),
    "I do not know",
)
END = 1


def write_model(folder: Path) -> None:
    """A Llama that says one of `EDITS` and then the end, nearly always, and its tokenizer of bytes
    and lines of the prompt.
    """
    import torch  # pyright: ignore[reportMissingImports]
    from tokenizers import AddedToken, Tokenizer, decoders, models, pre_tokenizers  # pyright: ignore[reportMissingImports]
    from transformers import LlamaConfig, LlamaForCausalLM, PreTrainedTokenizerFast  # pyright: ignore[reportMissingImports]

    pieces = ["<s>", "</s>", *sorted(pre_tokenizers.ByteLevel.alphabet())]
    tokenizer = Tokenizer(models.BPE({piece: number for number, piece in enumerate(pieces)}, []))
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.decoder = decoders.ByteLevel()
    lines = {line for line in system_text(study()).splitlines() if len(line) > 20}
    tokenizer.add_tokens([AddedToken(one, normalized=False) for one in (*EDITS, *sorted(lines))])
    PreTrainedTokenizerFast(
        tokenizer_object=tokenizer, bos_token="<s>", eos_token="</s>", pad_token="</s>"
    ).save_pretrained(folder)
    edits = slice(len(pieces), len(pieces) + len(EDITS))
    config = LlamaConfig(
        vocab_size=edits.stop + len(lines),
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=2,
        num_attention_heads=2,
        max_position_embeddings=40_000,
        bos_token_id=0,
        eos_token_id=END,
        pad_token_id=END,
        tie_word_embeddings=False,
    )
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = LlamaForCausalLM(config)
    with torch.no_grad():
        said, heard = (
            model.get_parameter(name) for name in ("lm_head.weight", "model.embed_tokens.weight")
        )
        heard[:, 0], heard[edits, 1] = 1.0, 2.0  # 1 marks an edit that was said
        said[edits, 0], said[edits, 1], said[END, 1] = 2.0, -4.0, 6.0
    model.save_pretrained(folder)


@dataclass
class Served:
    """`url` : base URL.

    `loaded` : folders that were loaded, in order. `questions` : bodies of the questions.
    """

    model: Any
    tokenizer: Any
    url: str = ""
    loaded: list[str] = field(default_factory=list)
    questions: list[dict[str, Any]] = field(default_factory=list)
    one_by_one: threading.Lock = field(default_factory=threading.Lock)

    def load(self, folder: str) -> None:
        from transformers import AutoModelForCausalLM  # pyright: ignore[reportMissingImports]

        self.model = AutoModelForCausalLM.from_pretrained(folder).eval()
        self.loaded.append(folder)

    def answer(self, asked: dict[str, Any]) -> dict[str, Any]:
        """A chat completion, drawn token by token with the log-probabilities of the whole
        distribution.
        """
        import torch  # pyright: ignore[reportMissingImports]

        tokens = self.tokenizer(
            prompt_text(asked["messages"]) + "\n\nassistant:", return_tensors="pt"
        )["input_ids"]
        random, said, cache = torch.Generator().manual_seed(asked["seed"]), [], None
        with torch.inference_mode():
            while len(said) < asked["max_tokens"] and (not said or tokens.item() != END):
                read = self.model(
                    input_ids=tokens, past_key_values=cache, use_cache=True, logits_to_keep=1
                )
                cache, distribution = (
                    read.past_key_values,
                    torch.log_softmax(read.logits[0, -1].float(), -1),
                )
                tokens = torch.multinomial(distribution.exp(), 1, generator=random)[None]
                said.append((tokens.item(), distribution[tokens.item()].item()))
        entries = [{"token": f"token_id:{token}", "logprob": logprob} for token, logprob in said]
        reason = "stop" if said[-1][0] == END else "length"
        return {
            "object": "chat.completion",
            "choices": [{"logprobs": {"content": entries}, "finish_reason": reason}],
        }

    def turn(self, handler: Handler) -> None:
        """What the server does with any request."""
        body = json.loads(handler.body)
        with self.one_by_one:
            if handler.path == "/update_weights_from_disk":
                self.load(body["model_path"])
                reply: dict[str, Any] = {"success": True, "message": "loaded"}
            else:
                self.questions.append(body)
                reply = self.answer(body)
        handler.reply(json.dumps(reply).encode())


@contextmanager
def serving(folder: Path) -> Iterator[Served]:
    """A server of the model in a folder on a free port of 127.0.0.1."""
    from transformers import AutoModelForCausalLM, AutoTokenizer  # pyright: ignore[reportMissingImports]

    served = Served(
        AutoModelForCausalLM.from_pretrained(folder).eval(), AutoTokenizer.from_pretrained(folder)
    )
    with scripted(served.turn) as script:
        served.url = script.url
        yield served
