"""The story of an opened device, story.json: what was measured and why, what it told, and the
answer.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.foreign_data import json_in
from ibrid.frozen import Frozen
from ibrid.writing import PlainData, inside, write_json

SCHEMA = "ibrid.open/1"
STORY = "story.json"


@dataclass(frozen=True)
class DeviceExperiment(Frozen):
    """One measurement of the device.

    kind : sweep or event. op : operating point that was asked for. event : as `ibrid record` takes
    it, "" for a sweep. why : reason, a sentence. separates : (structure, structure, expected bits).
    file, sha256 : the measurement, empty where the device refused it, which `refused` says.
    ruled_out : what the measurement excluded, in sentences. answer : program after it, "" before
    the first identification. grade, nrmse : of that answer.
    """

    kind: str
    op: str
    why: str
    event: str = ""
    frequencies: tuple[float, ...] = ()
    separates: tuple[tuple[str, str, float], ...] = ()
    simulated_s: float = 0.0
    file: str = ""
    sha256: str = ""
    refused: str = ""
    ruled_out: tuple[str, ...] = ()
    answer: str = ""
    grade: str = ""
    nrmse: float | None = None


@dataclass(frozen=True)
class OpeningStory(Frozen):
    """What happened so far.

    key : hash of what the measurements depend on (device file, model, settings). settings : what
    the user chose (points, budget, gain, effort, seed). ending : why no
    more was measured, "" while it is going on. answer, held_out : see `ibrid.open/1`.
    """

    key: str
    device: str
    experiments: tuple[DeviceExperiment, ...] = ()
    ending: str = ""
    answer: Mapping[str, Any] = field(default_factory=dict)
    held_out: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> PlainData:
        """Return the story in the format `ibrid.open/1`."""
        content = json.loads(json.dumps({"schema": SCHEMA, **asdict(self)}))
        return {**content, "hash": _hash_of(content)}

    def write(self, folder: Path) -> None:
        """Write story.json."""
        write_json(inside(folder, STORY), self.to_json())


def read_story(folder: Path) -> OpeningStory:
    """Read the story that a stopped run left.

    Raises IbridError where there is none, or where it or a measurement was changed since.
    """
    path = inside(folder, STORY)
    if not path.is_file():
        raise IbridError(
            f"{folder}: holds no story to go on with; leave --resume out to begin, or name the "
            "folder of one"
        )
    try:
        content = json_in(path.read_text(encoding="utf-8"))
        told = content.pop("hash")
        is_whole = told == _hash_of(content) and content.pop("schema") == SCHEMA
        experiments = tuple(
            DeviceExperiment(
                **{
                    **one,
                    "frequencies": tuple(one["frequencies"]),
                    "separates": tuple(map(tuple, one["separates"])),
                    "ruled_out": tuple(one["ruled_out"]),
                }
            )
            for one in content.pop("experiments")
        )
        story = OpeningStory(experiments=experiments, **content)
    except (ValueError, KeyError, TypeError, AttributeError, OSError):
        is_whole = False
    if not is_whole:
        raise IbridError(
            f"{path}: must be as ibrid open left it, and was changed; begin in another folder"
        )
    for one in story.experiments:
        if one.file and digest_of(inside(folder, one.file)) != one.sha256:
            raise IbridError(
                f"{folder / one.file}: must be as ibrid open measured it, and is gone or changed; "
                "begin in another folder"
            )
    return story


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, "" where it cannot be read."""
    try:
        return sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def _hash_of(content: Mapping[str, Any]) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
