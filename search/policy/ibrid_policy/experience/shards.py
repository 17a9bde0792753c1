"""Experience on disk: numbered shards of examples, each written whole once it is there, so that
making them can go on.

FOLDER/shard_00012.jsonl      the examples of 10 inverters, one a line
"""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

from ibrid.errors import IbridError
from ibrid.writing import write_whole
from ibrid_policy.experience.examples import Example, draw_examples

#: Inverters of one shard.
IN_A_SHARD = 10


def shard_path(folder: Path, shard: int) -> Path:
    """Where a shard lies."""
    return folder / f"shard_{shard:05d}.jsonl"


def shard_text(seed: int, shard: int, families: Sequence[str] | None = None) -> str:
    """One shard, an example a line.

    Whoever makes it may sit on another machine, so it touches no file.
    """
    return "".join(
        f"{json.dumps(example.to_json())}\n"
        for number in range(shard * IN_A_SHARD, (shard + 1) * IN_A_SHARD)
        for example in draw_examples(seed, number, families=families)
    )


def read_shards(folder: Path, shards: Sequence[int]) -> Iterator[Example]:
    """The examples of these shards; IbridError for one that is missing or damaged."""
    for shard in shards:
        path = shard_path(folder, shard)
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = (
                "is missing"
                if isinstance(error, FileNotFoundError)
                else "cannot be read; delete it"
            )
            raise IbridError(
                f"{path}: {why}; run ibrid policy train again with --resume to make it anew"
            ) from None
        for number, line in enumerate(text.splitlines(), 1):
            try:
                yield Example.from_json(json.loads(line))
            except (ValueError, TypeError, KeyError, RecursionError):
                raise IbridError(
                    f"{path} line {number}: is no example; delete the file and run again"
                ) from None


class Crew(Protocol):
    """Whoever works on tasks: in the order in which they end, (task, result)."""

    def work(
        self, task: Callable[..., Any], arguments: Sequence[tuple]
    ) -> Iterator[tuple[tuple, Any]]:
        """Do task(*one) for each of the arguments."""
        ...


class Processes:
    """`number` processes of this machine; one works in this process."""

    def __init__(self, number: int) -> None:
        self.number = number

    def work(
        self, task: Callable[..., Any], arguments: Sequence[tuple]
    ) -> Iterator[tuple[tuple, Any]]:
        """See `Crew`."""
        if self.number == 1:
            yield from ((one, task(*one)) for one in arguments)
            return
        with ProcessPoolExecutor(self.number, mp_context=get_context("spawn")) as pool:
            try:
                waiting = {pool.submit(task, *one): one for one in arguments}
                while waiting:
                    for done in wait(waiting, return_when=FIRST_COMPLETED).done:
                        yield waiting.pop(done), done.result()
            finally:
                pool.shutdown(cancel_futures=True)


class RayCluster:
    """Tasks on a Ray cluster that has been joined; a lost worker's task is done again."""

    def work(
        self, task: Callable[..., Any], arguments: Sequence[tuple]
    ) -> Iterator[tuple[tuple, Any]]:
        """See `Crew`."""
        import ray  # an extra, and slow to import

        remote = ray.remote(num_cpus=1, max_retries=3)(task)
        waiting = {remote.remote(*one): one for one in arguments}
        while waiting:
            (done,), _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(done), ray.get(done)


def make_shards(
    folder: Path,
    seed: int,
    shards: Sequence[int],
    crew: Crew,
    families: Sequence[str] | None = None,
) -> Iterator[tuple[int, int]]:
    """Have the shards made that are not there, and write each here as it comes; (shard, number of
    examples).
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [(seed, one, families) for one in shards if not shard_path(folder, one).is_file()]
    for (_, shard, _), text in crew.work(shard_text, wanted):
        write_whole(shard_path(folder, shard), text)
        yield shard, text.count("\n")
