"""The policy and learning during a search: a distribution of its own, asked for when it is needed
and never before.
"""

from importlib import import_module
from typing import Any

from ibrid.errors import IbridError

#: Where a run's store keeps what was learnt.
UPDATES = "learning"


def policy_part(module: str) -> Any:
    """A module of ibrid_policy by its name in there; IbridError, naming what to install, where the
    package is missing.
    """
    try:
        return import_module(f"ibrid_policy.{module}")
    except ModuleNotFoundError as missing:
        if missing.name != "ibrid_policy":
            raise
        raise IbridError(
            "the policy and --learn are the distribution ibrid-policy, which is not installed; in "
            "a clone of ibrid: "
            "pip install ./search/policy"
        ) from None
