"""A base that a file states and the user says otherwise."""

from collections.abc import Mapping
from typing import Any

from ibrid.measurement.importing.import_account import SAME, Account, number_said
from ibrid.measurement.importing.told import base_of
from ibrid.measurement.sweeps.quantities import engineering


def mind_other_base(
    where: str, told: Mapping[str, Any], account: Account, *, per_unit: bool
) -> None:
    """Ask on which base matrices per unit are, of those in S or ohm remark, where the base of a
    file is not that of `--base`.
    """
    said = told.get("base")
    stated = [number_said(told.get(key)) for key in ("s_base_va", "v_base_v")]
    if not said:
        return
    ours = base_of(str(said), "--base")
    if all(
        one is None or abs(one / own - 1) <= SAME for one, own in zip(stated, ours, strict=True)
    ):
        return
    power, voltage = (one or own for one, own in zip(stated, ours, strict=True))
    file = f"{engineering(power, 'VA')},{engineering(voltage, 'V')}".replace(" ", "")
    if per_unit:
        account.ask(
            f"on which base its per unit is: {where} states {file}, --base is {said}",
            f"--unit pu:{file} (--p and --q of that base, too)",
            f"--unit pu:{said}",
        )
    else:
        account.remark(f"base: {said} as said, while {where} states {file}")
