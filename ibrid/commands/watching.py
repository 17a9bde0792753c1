"""`ibrid watch RUN`: a live page about a search, on this machine alone."""

from argparse import Namespace
from pathlib import Path
from typing import Any

from ibrid.commands import inputs
from ibrid.commands.own_kinds import add_kinds_option


def declare(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "watch", help="a live page about a search: curve, lineage, candidates; for this machine"
    )
    parser.add_argument(
        "folder", metavar="RUN", help="folder of ibrid search, running or ended; nothing is written into it"
    )
    parser.add_argument(
        "--port", type=inputs.natural, default=0, metavar="N", help="on the loopback address (any free one)"
    )
    add_kinds_option(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Serve until Ctrl-C."""
    from ibrid_search.watching import watch

    from ibrid.modules.vocabulary import choose_vocabulary

    kinds = choose_vocabulary(inputs.vocabulary(files=arguments.kinds))
    watch(Path(arguments.folder), arguments.port, kinds, lambda url: print(f"{url} (Ctrl-C ends it)", flush=True))
    return 0
