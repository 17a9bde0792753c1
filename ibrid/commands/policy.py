"""`ibrid policy train --out DIR`: makes the small learned proposer anew."""

from argparse import Namespace
from typing import Any

from ibrid.commands import inputs


def declare(commands: Any) -> None:
    """Add the command to the parser."""
    train = commands.add_parser("policy", help="train the small learned proposer anew, about an hour on two free cores")
    train.add_argument(
        "verb", metavar="train", choices=("train",), help="draw inverters, damage and fit them, learn the repairs"
    )
    train.add_argument("--out", required=True, metavar="DIR", help="folder of the policy; a new one, unless --resume")
    train.add_argument(
        "--from",
        dest="runs",
        nargs="+",
        default=[],
        metavar="RUN",
        help="learn from these finished searches which ideas are right, for ibrid search --proposer diagnosis --policy DIR; in "
        "seconds, and none of the other options",
    )
    train.add_argument("--inverters", type=inputs.natural, default=2500, metavar="N", help="drawn to learn from (2500)")
    train.add_argument("--steps", type=inputs.natural, default=16000, metavar="N", help="of training (16000)")
    train.add_argument(
        "--size",
        default="small",
        help="of the model: small, as shipped, 1.1 million parameters (default) | large, 5 million",
    )
    train.add_argument("--seed", type=inputs.natural, default=0, metavar="N", help="of everything random (0)")
    train.add_argument("--workers", type=inputs.natural, metavar="N", help="processes that draw and fit (all cores)")
    train.add_argument("--ray", metavar="ADDRESS", help="draw and fit on a Ray cluster: auto, or HEAD:6379")
    train.add_argument("--resume", action="store_true", help="go on with the training in the folder")
    train.set_defaults(run=run_train)


def run_train(arguments: Namespace) -> int:
    """Train and say how good the policy is."""
    if arguments.runs:
        return _learn_from_runs(arguments)
    from ibrid_search.policy_package import policy_part

    return policy_part("command").train(arguments)


def _learn_from_runs(arguments: Namespace) -> int:
    """What finished searches teach the diagnosis."""
    from pathlib import Path

    from ibrid_search.experience import experience_of
    from ibrid_search.run_folder import make_folder

    found, folder = experience_of(arguments.runs), Path(arguments.out)
    make_folder(folder)
    found.write(folder)
    print(f"{'idea':<40} {'tried':>6} {'in the answer':>14} {'bonus in ln(error)':>19}")
    for part in sorted(found.tried, key=lambda part: -found.bonus(part)):
        print(f"{part:<40} {found.tried[part]:>6} {found.kept.get(part, 0):>14} {found.bonus(part):>19.2f}")
    print(f"\n{folder}: experience.json; search with --proposer diagnosis --policy {folder}")
    return 0
