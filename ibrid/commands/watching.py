"""`ibrid watch RUN`: a live page about a search, on this machine alone."""

from argparse import Namespace
from pathlib import Path

from ibrid_search.watching import watch

from ibrid.commands import inputs
from ibrid.modules.vocabulary import choose_vocabulary


def run(arguments: Namespace) -> int:
    """Serve until Ctrl-C."""
    kinds = choose_vocabulary(inputs.vocabulary(files=arguments.kinds))
    watch(Path(arguments.folder), arguments.port, kinds, lambda url: print(f"{url} (Ctrl-C ends it)", flush=True))
    return 0
