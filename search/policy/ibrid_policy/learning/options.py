"""Options of `ibrid search --learn`: `--learn-NAME`, one for each setting."""

from collections.abc import Callable, Mapping
from typing import Any

from ibrid.commands import inputs

#: Settings of learning that have an option: what it takes, how it is read, and what it is for.
LEARNING: Mapping[str, tuple[str, Callable[[str], Any], str]] = {
    "contexts": ("N", inputs.natural, "questions between two updates (paper 32, small 1)"),
    "group": ("N", inputs.natural, "answers to each question (paper 16, small 8)"),
    "epochs": ("N", inputs.natural, "updates from each batch (1)"),
    "optimizer": (
        "WAY",
        str,
        "what makes a step of the weights from a gradient: adam (paper), or sgd (small)",
    ),
    "rate": ("X", inputs.positive, "learning rate (by the optimizer and the size of the model)"),
    "judge": (
        "WHO",
        str,
        "fit, every answer is evaluated (paper), or look, a first look judges all answers to a "
        "question by what they gain on "
        "their parent, the candidate they edit, and one of them is evaluated (small)",
    ),
    "baseline": (
        "WAY",
        str,
        "answers are compared with their group, those to the same question (the default), or with "
        "all of their batch by "
        "what they gain on their parent",
    ),
    "advantages": (
        "WAY",
        str,
        "what is made better: the mean answer (paper), or the best one, entropic (small)",
    ),
    "clip_low": (
        "X",
        inputs.positive,
        "a token whose probability fell below 1 - X of what it was is pushed no further (0.2)",
    ),
    "clip_high": (
        "X",
        inputs.positive,
        "one whose probability rose above 1 + X is pushed no further (0.28)",
    ),
    "divergence": (
        "X",
        inputs.finite,
        "weight of the divergence (KL) from the policy at the start (paper 0, small 0.1)",
    ),
    "lora": (
        "N",
        inputs.natural,
        "rank of low-rank adapters, which need the package peft (0: train all weights)",
    ),
    "longest": ("N", inputs.natural, "tokens of a language model's answer at most (512)"),
    "question": (
        "N",
        inputs.natural,
        "tokens of a question to a language model at most; details are left out (16000)",
    ),
    "threads": (
        "N",
        inputs.natural,
        "threads of torch; another number gives other results in the last digits (1)",
    ),
}
