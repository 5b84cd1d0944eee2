"""Numbers as a reader wants them: no more digits than their uncertainty carries, with units."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal

from granite_lab.estimate import Estimate

NONE = "–"
"""What stands in place of a number that is not known."""

_SPACE = "\u00a0"  # no line break between a number and its unit
_UNIT = re.compile(r"(?<=\d) (?=[%°±]|(?:m/s|mm/s|s/m|N m|ms|mrad|points)\b)|(?<=±) ")
_DIGITS = 15
"""Decimal digits that a double holds for sure."""
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def decimals_for(std: float) -> int:
    """Return the decimal place a standard deviation is rounded to.

    The rule of the Particle Data Group: of the three leading digits, 100 to 354 keep two, 355 to
    949 keep one, 950 to 999 become 1000 and keep two (which is the same place).
    """
    exponent, digits = _scientific(std, 3)
    return -exponent + (1 if int(digits.replace(".", "")) < 355 else 0)


def _scientific(value: float, digits: int) -> tuple[int, str]:
    """Return the decimal exponent of a number of any size and its mantissa, rounded to so many digits."""
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    return int(exponent), mantissa


def _power(exponent: int) -> str:
    return f"·10{str(exponent).translate(_SUPERSCRIPT)}"


def places(value: float, decimals: int) -> str:
    """Return a number with so many decimals and a true minus sign; there is no "−0.00"."""
    rounded = round(value, decimals) + 0.0  # no "-0"
    return f"{rounded:.{max(decimals, 0)}f}".replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, as a power of ten outside 1e-4 … 1e6."""
    if not math.isfinite(value):
        return NONE if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if value == 0:
        return "0"
    exponent, mantissa = _scientific(value, digits)
    if -4 <= exponent < 6:
        return places(value, digits - 1 - exponent)
    return mantissa.replace("-", "−") + _power(exponent)


def with_unit(text: str, unit: str) -> str:
    """Put a unit behind a printed number; ``-`` and the empty unit add nothing."""
    return text if text == NONE or unit in ("", "-") else f"{text}{_SPACE}{tidy_unit(unit)}"


def unbroken(text: str) -> str:
    """Return a text with no-break spaces between numbers and their units."""
    return _UNIT.sub(_SPACE, text)


def tidy_unit(unit: str) -> str:
    """Write a unit as a reader expects it: m/s² for m/s^2."""
    return unit.replace("^2", "²").replace("^3", "³").replace("deg", "°").replace("ohm", "Ω")


def plural(n: int, noun: str) -> str:
    """Return a number of things in words: "1 trial", "2 quantities"."""
    many = f"{noun[:-1]}ies" if noun.endswith("ity") else f"{noun}s"
    return f"{n} {noun if n == 1 else many}"


def plus_minus(estimate: Estimate, unit: str = "", scale: float = 1.0) -> str:
    """Return ``value ± std unit``, both rounded to the place the standard deviation carries.

    Both have a common power of ten where a plain number would begin or end with many zeros.

    Args:
        estimate: value and std, in the unit of the record.
        unit: as printed.
        scale: from the record's unit to the printed one.
    """
    value, std = estimate.value * scale, abs(estimate.std * scale)
    if not math.isfinite(value):
        return NONE
    if not math.isfinite(std) or std == 0:
        return with_unit(significant(value), unit)
    exponent, decimals = _scientific(max(abs(value), std), _DIGITS)[0], decimals_for(std)
    if exponent + decimals >= _DIGITS:  # the last digit of the value says more than its std
        return with_unit(f"{significant(value, _DIGITS)} ± {significant(std, 2)}", unit)
    if (exponent >= 6 and decimals < 0) or (exponent < 0 and decimals > 6):
        both = f"{_shifted(value, exponent, decimals)} ± {_shifted(std, exponent, decimals)}"
        return with_unit(f"({both}){_power(exponent)}", unit)
    return with_unit(rounded(value, std).with_std, unit)


def _shifted(value: float, exponent: int, decimals: int) -> str:
    """Return a number over a power of ten, rounded to the place of so many decimals of the number itself."""
    return places(float(Decimal(value).scaleb(-exponent)), exponent + decimals)


def interval(low: float, high: float, unit: str = "", scale: float = 1.0) -> str:
    """Return ``low to high unit``, both with the digits that half the width carries."""
    low, high = low * scale, high * scale
    if math.isfinite(low) and high <= low:
        return with_unit(significant(low), unit)
    return with_unit(rounded(low, (high - low) / 4, low, high).interval, unit)


def times(gap: float) -> str:
    """Return a gap with two decimals where it is small."""
    return places(gap, 2) if abs(gap) < 10 else significant(gap)


def percent(share: float) -> str:
    """Return a share in percent; never 100 % where something is left."""
    if not math.isfinite(share):
        return "–"
    if 0.99 < share < 1:
        return with_unit("over 99", "%")
    return with_unit(significant(100 * share, 3 if share > 0.1 else 2).removesuffix(".0"), "%")


def chance(probability: float) -> str:
    """Return a probability in percent; never 0 % or 100 %, which no data give."""
    return with_unit("below 1", "%") if probability < 0.01 else percent(min(probability, 0.999))


def percent_of(share: Estimate) -> str:
    """Return a share ± its standard error in percent."""
    return plus_minus(share, "%", 100)


SHOWN_AS: dict[str, tuple[str, float]] = {
    "m/s": ("mm/s", 1e3),
    "rad": ("°", 180 / math.pi),
    "rad/s": ("°/s", 180 / math.pi),
    "-": ("points", 100.0),
    "": ("points", 100.0),
}
"""Unit and factor in which a small difference of a channel is printed (slip ratios: percentage points)."""


def shown_as(unit: str) -> tuple[str, float]:
    """Return the unit, as a reader expects it, and factor in which differences in `unit` are printed."""
    return SHOWN_AS.get(unit, (tidy_unit(unit), 1.0))


def axis_unit(unit: str) -> tuple[str, float]:
    """Return the unit, as a reader expects it, and the factor in which values in `unit` are drawn."""
    return {"-": ("%", 100.0), "m/s": (unit, 1.0)}.get(unit) or shown_as(unit)


@dataclass(frozen=True)
class Number:
    """A number as it stands everywhere: value, std and 95 % interval rounded to one decimal place.

    Attributes:
        value, std, low, high: rounded, in `unit`; NaN where not known.
        unit: as printed.
        decimals: of all four.
    """

    value: float
    std: float
    low: float
    high: float
    unit: str
    decimals: int

    @property
    def text(self) -> str:
        """The value without its unit."""
        return places(self.value, self.decimals) if math.isfinite(self.value) else NONE

    @property
    def quantity(self) -> str:
        """The value with its unit."""
        return with_unit(self.text, self.unit)

    @property
    def with_std(self) -> str:
        """``value ± std``, without the unit."""
        finite = math.isfinite(self.value) and math.isfinite(self.std)
        return f"{self.text} ± {places(self.std, self.decimals)}" if finite else self.text

    @property
    def interval(self) -> str:
        """``low to high``, without the unit."""
        if not math.isfinite(self.low + self.high):
            return NONE
        return f"{places(self.low, self.decimals)} to {places(self.high, self.decimals)}"

    def holds(self, value: float) -> bool | None:
        """Whether the interval, as printed, holds a value; None where there is no interval."""
        return self.low <= value <= self.high if math.isfinite(self.low + self.high + value) else None

    def as_json(self) -> dict[str, object]:
        """Return the rounded values with their unit."""
        return {"value": self.value, "std": self.std, "ci95": [self.low, self.high], "unit": self.unit}


def rounded(
    value: float,
    std: float = math.nan,
    low: float = math.nan,
    high: float = math.nan,
    *,
    unit: str = "",
    scale: float = 1.0,
) -> Number:
    """Return a value, its std and its interval, rounded to the decimal place that the std carries.

    Args:
        value, std, low, high: in the unit of the record.
        unit: as printed.
        scale: from the record's unit to the printed one.
    """
    scaled_std, scaled = abs(std * scale), [x * scale for x in (value, low, high)]
    if math.isfinite(scaled_std) and scaled_std > 0:
        decimals = decimals_for(scaled_std)
    elif math.isfinite(scaled[0]) and scaled[0]:
        decimals = 2 - _scientific(scaled[0], _DIGITS)[0]
    else:
        decimals = 0
    numbers = [round(x, decimals) + 0.0 if math.isfinite(x) else math.nan for x in scaled]
    return Number(numbers[0], round(scaled_std, decimals), numbers[1], numbers[2], unit, decimals)
