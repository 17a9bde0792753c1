"""Numbers as an engineer reads them."""


def hertz(value: float) -> str:
    """Three significant digits, kHz from 1000 Hz on."""
    return f"{_digits(value / 1000)} kHz" if value >= 999.5 else f"{_digits(value)} Hz"


def band(low: float, high: float) -> str:
    """A band in one unit where possible."""
    if low == high:
        return hertz(low)
    if (low >= 999.5) == (high >= 999.5):
        number, unit = hertz(low).split()
        return f"{number}-{hertz(high).split()[0]} {unit}"
    return f"{hertz(low)} - {hertz(high)}"


def percent(value: float) -> str:
    """Two significant digits."""
    return f"{float(f'{100 * value:.2g}'):g} %"


def _digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"
