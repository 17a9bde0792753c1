"""Readers of binary files as bad as they come, for the process that reads files of others."""

import atexit
import os
import time

import numpy as np


def plain(content: bytes) -> dict[str, np.ndarray]:
    """The bytes as numbers, and a word."""
    return {"x": np.frombuffer(content, dtype=np.uint8), "word": np.array("abc")}


def crashes(content: bytes) -> dict[str, np.ndarray]:
    """Ends as a null pointer does."""
    import ctypes

    ctypes.string_at(0)
    return plain(content)


def ends_badly(content: bytes) -> dict[str, np.ndarray]:
    """Reads well, and leaves something that kills the process at its end, as threads of Arrow
    do.
    """
    atexit.register(os.abort)
    return plain(content)


def exits(content: bytes) -> dict[str, np.ndarray]:
    """Leaves quietly, in the middle of an answer."""
    os.write(1, b"PK")
    os._exit(0)


def hangs(content: bytes) -> dict[str, np.ndarray]:
    """Waits for ever."""
    while True:
        time.sleep(60)


def swells(content: bytes) -> dict[str, np.ndarray]:
    """Takes all memory there is, by pieces."""
    return {"x": np.concatenate([np.ones(1 << 25) for _ in range(1 << 10)])}


def floods(content: bytes) -> dict[str, np.ndarray]:
    """Writes for ever."""
    while True:
        os.write(1, bytes(1 << 20))


def answers_much(content: bytes) -> dict[str, np.ndarray]:
    """More than a sweep can be."""
    return {"x": np.zeros(20 << 20)}


def raises(content: bytes) -> dict[str, np.ndarray]:
    """Fails with an error of its own kind and several lines."""
    raise KeyError("one\ntwo\u2028three")
