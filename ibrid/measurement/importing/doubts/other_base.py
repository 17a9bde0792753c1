"""A base or a rating that a file states and the user says otherwise."""

from collections.abc import Mapping, Sequence
from typing import Any

from ibrid.measurement.importing.import_account import SAME, Account, number_said
from ibrid.measurement.importing.told import base_beside, base_in_words, base_of


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
    stated = [number_said(told.get(key)) for key in ("s_base_va", "v_base_v")]
    if per_unit and not agree(stated, ours):
        power, voltage = (one or own for one, own in zip(stated, ours, strict=True))
        file = base_in_words(power, voltage)
        account.ask(
            f"on which base its per unit is: {where} states {file}, --base is {said}",
            f"--unit pu:{file} (--p and --q of that base, too)",
            f"--unit pu:{said}",
        )
    elif not agree(beside := base_beside(told), ours):
        file = base_in_words(*beside)
        account.remark(f"base: {said} as said, while {where} states {file}")


def agree(stated: Sequence[float | None], ours: Sequence[float]) -> bool:
    """Whether a power and a voltage, as far as they are stated, are those of a base."""
    return all(
        one is None or abs(one / own - 1) <= SAME for one, own in zip(stated, ours, strict=True)
    )
