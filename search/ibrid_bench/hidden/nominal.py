"""What the engineer believes the parameters to be: the true values, each wrong by chance."""

from collections.abc import Mapping
from math import log

import numpy as np

#: Share of the values that are wrong by more, and by how much more.
_WORSE, _FACTOR = 0.15, 0.40 / 0.15
#: Nobody believes in more than so many standard deviations.
_MOST = 2.5
#: A value that is far off is wrong by a factor between these two, or its inverse.
_FAR = (2.0, 3.0)


def nominal_values(
    values: Mapping[str, float], rng: np.random.Generator, *, error: float, gross: bool
) -> tuple[dict[str, float], list[str]]:
    """Log-normal errors: standard deviation `error` of the logarithm, 2.7 times that for 15 % of
    the values.

    gross : one or two of them are off by a factor of 2 to 3 instead. Returns the nominal values and
    the names of those.
    """
    spread = np.where(rng.random(len(values)) < _WORSE, error * _FACTOR, error)
    shift = spread * np.clip(rng.standard_normal(len(values)), -_MOST, _MOST)
    count = int(rng.integers(1, 3)) if gross else 0
    far = rng.choice(len(values), size=count, replace=False)
    shift[far] = rng.choice([-1.0, 1.0], size=count) * rng.uniform(
        log(_FAR[0]), log(_FAR[1]), size=count
    )
    names = list(values)
    nominal = {
        name: float(values[name] * np.exp(one)) for name, one in zip(names, shift, strict=True)
    }
    return nominal, sorted(names[k] for k in far)
