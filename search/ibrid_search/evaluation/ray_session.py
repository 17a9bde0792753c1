"""A Ray of one's own on the loopback interface, or a cluster that exists; closed without touching
anybody else's.
"""

import ipaddress
import logging
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

from ibrid.errors import IbridError
from ibrid.interrupts import heed_interrupt

#: A cluster must answer within so many seconds; Ray itself would try for two minutes and end the
#: process.
ANSWER = 20.0
#: Something must listen at its address within so many.
KNOCK = 5.0
#: What is said in place of an address for a local Ray, started and ended with the search.
OWN = "local"
#: Bytes of shared memory of a local Ray. Jobs and records are small; the least that Ray accepts is
#: 75 MiB.
SHARED_MEMORY = 80 * 2**20
#: Tells whether a cluster answers, in a process that can be stopped.
_PROBE = """
import logging, sys, ray
ray.init(address=sys.argv[1], log_to_driver=False, logging_level=logging.CRITICAL)
"""


#: What a cluster job was sent with, the copy of its folder among it. Ray deletes that copy, the
#: working directory, as soon as a process that connected with it disconnects.
_JOB = "RAY_JOB_CONFIG_JSON_ENV_VAR"

#: How folders of a local Ray begin, and the file in each that its search holds locked.
_STEM, _LOCK = "ibrid-ray-", "lock"


BROKEN_OFF = (
    "ibrid: the run broke off: its process was killed, or ended together with Ray's node; every "
    "evaluation that was "
    "stored is kept, go on with the same command and --resume"
)
_WAIT = (
    "import signal, sys\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\nsys.stdin.read(1) or "
    f"print({BROKEN_OFF!r})"
)


class RaySession:
    """A connection to Ray. `ray` : the module. `owned` : True when it was opened here and may be
    closed here.

    Unless `close` comes first, a small process of Python that waits at a pipe tells on standard
    error that the run broke off: Ray ends its process with its node, a scheduler by SIGKILL, before
    it can say anything.
    """

    def __init__(
        self, ray: Any, *, owned: bool, folder: Path | None = None, lock: IO[bytes] | None = None
    ):
        self.ray, self.owned = ray, owned
        self._folder, self._lock = folder, lock
        command = [sys.executable, "-S", "-E", "-c", _WAIT]
        self._last_words = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=2, close_fds=True
        )

    def close(self) -> None:
        """End what was started here: a local Ray, or the connection to a cluster. Again does
        nothing.
        """
        if self.owned:
            self.owned = False
            self.ray.shutdown()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        with suppress(OSError, ValueError):
            self._last_words.communicate(b"!", timeout=10)


def sweep_folders(place: Path) -> None:
    """Remove what searches left in `place` that were killed: nobody holds the lock of their
    folder.
    """
    for folder in place.glob(f"{_STEM}*"):
        with suppress(OSError):
            if (
                not folder.is_symlink()
                and folder.stat().st_uid == os.getuid()
                and (folder / _LOCK).is_file()
            ):
                with _locked(folder):
                    shutil.rmtree(folder, ignore_errors=True)


def _locked(folder: Path) -> IO[bytes]:
    """A file in the folder, locked until it is closed or the process ends; OSError when somebody
    else holds it.
    """
    import fcntl

    with ExitStack() as undone:
        file = undone.enter_context((folder / _LOCK).open("ab"))
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        undone.pop_all()
    return file


def require_cluster(address: str | None) -> None:
    """Raise IbridError before any work where nothing listens at the address of a cluster, or Ray is
    not installed.
    """
    if address not in (None, OWN):
        _head(address)
    if address is not None and find_spec("ray") is None:
        raise _not_installed()


def open_session(workers: int, address: str | None = None) -> RaySession:
    """Start a local Ray with room for `workers`, or connect to the cluster at `address` (HOST:PORT
    or "auto"; `OWN` is none).

    Where this process is connected already, that connection is used and left open.

    Raises IbridError when Ray is not installed, does not start, or no cluster answers.
    """
    address = None if address == OWN else address
    head = None if address is None else _head(address)
    if address == "auto" and "ray" not in sys.modules:
        _use_token()
    ray = _import_ray(local=address is None)
    if ray.is_initialized():
        connected = ray.get_runtime_context().gcs_address
        if head not in (None, connected):
            raise IbridError(
                f"this process is connected to the Ray at {connected} and cannot use {head} beside "
                "it; leave the "
                "address out, or call ray.shutdown() before"
            )
        return RaySession(ray, owned=False)
    with _own_signals():
        return _start(ray, workers) if head is None else _connect(ray, head)


def _head(address: str) -> str:
    """HOST:PORT of the cluster's head. Raises IbridError, at once in most cases, unless something
    listens there.

    "auto" is RAY_ADDRESS, which a cluster job has, or else what `ray start` left on this machine.
    Ray's own "auto" would also take the local Ray of another search.
    """
    if address == "auto":
        note = Path(os.environ.get("RAY_TMPDIR", "/tmp")) / "ray" / "ray_current_cluster"
        address = os.environ.get("RAY_ADDRESS") or (
            note.read_text().strip() if note.is_file() else ""
        )
        if not address:
            raise IbridError(
                "no Ray cluster runs on this machine: RAY_ADDRESS is not set and ray start left no "
                "address; give the "
                "HOST:PORT of the cluster's head, or leave --ray out for processes of this machine"
            )
    host, _, port = address.rpartition(":")
    digits = re.fullmatch(r"[0-9]{1,5}", port)
    if not is_host(host) or digits is None or not 0 < int(port) < 65536:
        raise IbridError(
            f"a Ray cluster is named by HOST:PORT of its head, or auto, found "
            f"{address!r:.80}; from outside a cluster send the search there with ray job submit"
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=KNOCK).close()
    except OSError as error:
        raise _no_cluster(address, _line(error)) from None
    return address


def is_host(text: str) -> bool:
    """Whether a text can be the name or the address of a machine, an IPv6 one in brackets."""
    try:
        if text.startswith("[") and text.endswith("]"):
            return bool(ipaddress.IPv6Address(text[1:-1]))
        if re.fullmatch(r"[0-9.]+", text):
            return bool(ipaddress.IPv4Address(text))
    except ValueError:
        return False
    labels = text.removesuffix(".").split(".")
    fine = (re.fullmatch(r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?", one) for one in labels)
    return len(text) < 254 and all(fine)


def _use_token() -> None:
    """For the cluster of this machine, use its token where there is one, as Ray does; read when Ray
    is imported.
    """
    given = {"RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"} & set(os.environ)
    if given or (Path.home() / ".ray" / "auth_token").is_file():
        os.environ.setdefault("RAY_AUTH_MODE", "token")


def _import_ray(*, local: bool) -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if "ray" not in sys.modules:  # both are read once, at import
        if local:  # without it Ray takes localhost for the address of the network card
            os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
            # at Ray's 15 a busy machine starves them: three minutes for what one process does in
            # nine seconds
            os.environ.setdefault("RAY_worker_niceness", "0")
        # a worker that dies is our business; no line of Ray's belongs between the lines of a search
        os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".")
    try:
        import ray
    except ImportError:
        raise _not_installed() from None
    return ray


def _not_installed() -> IbridError:
    return IbridError(
        "a Ray cluster needs Ray, which is not installed; pip install 'ibrid[ray]', or leave --ray "
        "out"
    )


def _start(ray: Any, workers: int) -> RaySession:
    posix, lock = hasattr(os, "getuid") and os.path.isdir("/tmp"), None
    folder = Path(tempfile.mkdtemp(prefix=_STEM, dir="/tmp" if posix else None))
    if posix:
        sweep_folders(folder.parent)
        lock = _locked(folder)
    started = False
    try:
        ray.init(
            address="local",
            num_cpus=workers,
            num_gpus=0,
            include_dashboard=False,
            object_store_memory=SHARED_MEMORY,
            log_to_driver=False,
            logging_level=logging.CRITICAL,
            _temp_dir=str(folder),
        )
        started = True
    except Exception as error:  # a node that is slow to start is an Exception of no class of Ray's
        heed_interrupt()
        why = _line(error).rstrip(".")
        raise IbridError(
            f"a local Ray did not start ({why}); try again, free memory, or use one worker"
        ) from None
    finally:
        if not started:
            ray.shutdown()
            shutil.rmtree(folder, ignore_errors=True)
    return RaySession(ray, owned=True, folder=folder, lock=lock)


def _connect(ray: Any, address: str) -> RaySession:
    _probe(address)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL)
    except (RuntimeError, ValueError, OSError, ray.exceptions.RayError) as error:
        raise _no_cluster(address, _line(error)) from None
    return RaySession(ray, owned=_JOB not in os.environ)


def _probe(address: str) -> None:
    """Raise IbridError unless the cluster answers."""
    probe = [sys.executable, "-P", "-c", _PROBE, address]
    environment = {name: value for name, value in os.environ.items() if name != _JOB}
    try:
        done = subprocess.run(
            probe,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=ANSWER,
            env=environment,
        )
    except subprocess.TimeoutExpired as error:
        reason = f"no answer within {ANSWER:g} s"
        if b"AuthToken" in bytes(error.stderr or b""):
            reason = (
                "it wants its token: set RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN_PATH unless the "
                "token is in ~/.ray"
            )
        raise _no_cluster(address, reason) from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        raise _no_cluster(address, lines[-1].strip() if lines else f"status {done.returncode}")


def _no_cluster(address: str, found: str) -> IbridError:
    return IbridError(
        f"no Ray cluster at {address} can be used from this machine ({found[:300]}); give the "
        "HOST:PORT that ray start "
        "--head printed, and run the search on a node of the cluster"
    )


@contextmanager
def _own_signals() -> Iterator[None]:
    """Ray takes SIGTERM for itself; where the program has a handler of its own, that one comes
    back.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if callable(before):
            signal.signal(signal.SIGTERM, before)


def _line(error: BaseException) -> str:
    """The first line of a message, short."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[0][:300]
