"""A base or a rating that a file states and the user says otherwise."""

from collections.abc import Mapping, Sequence
from typing import Any

from ibrid.measurement.importing.import_account import SAME, Account, base_beside
from ibrid.measurement.importing.told import base_in_words, base_of


def mind_other_base(
    where: str, told: Mapping[str, Any], account: Account, *, per_unit: bool
) -> None:
    """Ask on which base matrices per unit are, of those in S or ohm remark, where the base of a
    file is not that of `--base`; of a rating in its words remark.
    """
    said = told.get("base")
    if not said:
        return
    ours = base_of(str(said), "--base")
    stated = {key: told.get(key) for key in ("s_base_va", "v_base_v")}
    if per_unit and (file := other_base(stated, ours, whole=True)):
        account.ask(
            f"on which base its per unit is: {where} states {file}, --base is {said}",
            f"--unit pu:{file} (--p and --q of that base, too)",
            f"--unit pu:{said}",
        )
    elif file := other_base(told, ours):
        account.remark(f"base: {said} as said, while {where} states {file}")


def other_base(told: Mapping[str, Any], ours: Sequence[float], *, whole: bool = False) -> str:
    """The base or rating that a file states in place of ours, as `--base` takes it; "" where it
    states no other. whole : with our number where it states one alone.
    """
    pairs = list(zip(base_beside(told), ours, strict=True))
    if all(one is None or abs(one / own - 1) <= SAME for one, own in pairs):
        return ""
    return base_in_words(*(one or own * whole for one, own in pairs))
