"""`ibrid policy train --out DIR`: makes the small learned proposer anew."""

from argparse import Namespace


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

    learned, folder = experience_of(arguments.runs), Path(arguments.out)
    make_folder(folder)
    learned.write(folder)
    print(f"{'idea':<40} {'tried':>6} {'in the answer':>14} {'bonus in ln(error)':>19}")
    for part in sorted(learned.tried, key=lambda part: -learned.bonus(part)):
        print(f"{part:<40} {learned.tried[part]:>6} {learned.kept.get(part, 0):>14} {learned.bonus(part):>19.2f}")
    print(f"\n{folder}: experience.json; search with --proposer diagnosis --policy {folder}")
    return 0
