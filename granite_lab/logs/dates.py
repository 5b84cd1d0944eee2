"""Dates and times of day as loggers write them, read as seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from granite_lab.logs.trial import Array

if TYPE_CHECKING:
    import pandas as pd

_YEAR_FIRST = r"(?P<y>\d{4})[-/_.]?(?P<mo>\d\d?)[-/_.]?(?P<d>\d\d?)"
_YEAR_LAST = r"(?P<one>\d\d?)(?P<sign>[-/_.])(?P<two>\d\d?)[-/_.](?P<y>\d{4})"
_NAMED = r"(?P<d>\d\d?)[- ](?P<name>[A-Za-z]{3})[a-z]*[- ](?P<y>\d{4})"
_DAYS = (_YEAR_FIRST, _YEAR_LAST, _NAMED)
_FRACTION = r"(?:[.,:_](?P<f>\d+))?"
_CLOCK = rf"(?P<h>\d\d?)[:_.-]?(?P<m>\d\d)(?:[:_.-]?(?P<s>\d\d){_FRACTION})?"
_HALF = r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
_ZONE = r"(?: ?(?P<zone>Z|UTC|GMT|[+-]\d\d(?::?\d\d)?))?"
# Without a day the signs must be there, or the text is a number. Spreadsheets leave the hours out: 03:22.5.
_TIME = rf"(?:(?P<h>\d\d?):(?P<m>\d\d):(?P<s>\d\d){_FRACTION}|(?P<m2>\d\d?):(?P<s2>\d\d)[.,](?P<f2>\d+))"
_DAY = r"(?P<y>\d{4})[-/.](?P<mo>\d\d?)[-/.](?P<d>\d\d?)"
_FORMS = [
    *(re.compile(rf"{day}[T /_,-] ?{_CLOCK}{_HALF}{_ZONE}", re.ASCII) for day in _DAYS),
    re.compile(rf"{_TIME}{_HALF}{_ZONE}", re.ASCII),
    re.compile(_DAY, re.ASCII),
    re.compile(_YEAR_LAST, re.ASCII),
]
_CLOCKS = _FORMS[3:4]  # forms of a time without a day
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]

RANGES = (3600.0, 43200.0, 86400.0)
"""After which a time of day starts again [s]: without hours, of twelve hours, of a whole day."""


def _form(cells: Sequence[str]) -> re.Pattern[str] | None:
    """Return the form in which more than half of some cells are written, None if they are no dates."""
    bare = [cell.strip() for cell in cells]
    most = (len(bare) + 1) // 2  # as many in another form are too many
    others = (sum(1 for _ in islice((c for c in bare if not f.fullmatch(c)), most)) for f in _FORMS)
    return next((f for f, other in zip(_FORMS, others, strict=True) if other < most), None)


def are_dates(cells: Sequence[str]) -> bool:
    """Say whether more than half of some cells are dates or times of day in one form.

    Forms are ISO 8601, also with other signs in between (2026/03/01/12:00:00.25, 2026_03_01_12_00_00_250),
    3/1/2026 12:00:00 PM, 1.3.2026 12:00:00, 01-Mar-2026 12:00:00, times alone as 12:00:00.25, days alone.
    """
    return _form(cells) is not None


def are_times_of_day(cells: Sequence[str]) -> bool:
    """Say whether cells are times without a day."""
    return _form(cells) in _CLOCKS


def seconds(texts: pd.Series) -> tuple[Array, dict[int, str]]:
    """Return texts as seconds, exact to the microsecond, NaN for an empty cell; and what is none by its row.

    Dates count since 1970 (no zone: UTC), times of day since midnight.
    """
    written = texts.str.strip()
    filled = written[written.notna()]
    form = _form(filled.iloc[:100].tolist())
    if form is None:
        return np.full(len(texts), np.nan), {int(row): str(texts.iloc[row]) for row in np.flatnonzero(filled)}
    # Named groups cannot occur twice in a pattern: those of the short form of times end in 2.
    parts = written.str.extract(f"^{form.pattern}$", flags=re.ASCII)
    for key in ("m", "s", "f"):
        if f"{key}2" in parts:
            parts[key] = parts[key].fillna(parts[f"{key}2"])
    since = _days(parts) * 86400.0 + _clock(parts) - _zone(parts)
    wrong = np.flatnonzero(np.isnan(since) & texts.notna().to_numpy())
    return since, {row: str(texts.iloc[row]).strip() for row in wrong.tolist()}


def _number(parts: pd.DataFrame, key: str) -> Array:
    """Return a part (N,) as a number, 0 where a text that fits has none, NaN where nothing fits."""
    import pandas as pd  # noqa: PLC0415, heavy

    fits = parts.notna().any(axis=1).to_numpy()
    values = pd.to_numeric(parts[key]).to_numpy(dtype=np.float64) if key in parts else np.zeros(len(parts))
    return np.where(fits, np.nan_to_num(values), np.nan)


def _days(parts: pd.DataFrame) -> Array:
    """Return days (N,) since 1970, 0 for a time of day.

    Where day and month cannot be told apart, dots say that the day is first, and so does a log that would
    else last for months.
    """
    if "y" not in parts:
        return _number(parts, "y")
    if "one" in parts:
        first, second, dot = _number(parts, "one"), _number(parts, "two"), (parts["sign"] == ".").any()
        by_order = [_calendar(parts, month, day) for month, day in ((first, second), (second, first))]
        lost = [np.count_nonzero(np.isnan(days)) for days in by_order]
        lasts = [float(np.nanmax(days, initial=0) - np.nanmin(days, initial=1e9)) for days in by_order]
        day_first = lost[1] < lost[0] or (lost[1] == lost[0] and (dot or lasts[1] < lasts[0]))
        return by_order[int(day_first)]
    month = _number(parts, "mo")
    if "name" in parts:
        names = parts["name"].str.lower().map({name: k for k, name in enumerate(_MONTHS, 1)})
        month = np.asarray(names, dtype=np.float64)
    return _calendar(parts, month, _number(parts, "d"))


def _calendar(parts: pd.DataFrame, month: Array, day: Array) -> Array:
    """Return days (N,) since 1970 of years, months and days, NaN for one that no calendar has."""
    import pandas as pd  # noqa: PLC0415, heavy

    table = pd.DataFrame({"year": _number(parts, "y"), "month": month, "day": day})
    unique = table.drop_duplicates().reset_index(drop=True)
    parsed = pd.to_datetime(unique, errors="coerce")
    unique["since"] = (parsed - pd.Timestamp(0)) / pd.Timedelta(days=1)
    return table.merge(unique, how="left", on=["year", "month", "day"])["since"].to_numpy(dtype=np.float64)


def _clock(parts: pd.DataFrame) -> Array:
    """Return the time of day (N,) [s], NaN for one that no clock shows."""
    import pandas as pd  # noqa: PLC0415, heavy

    hour, minute, second = (_number(parts, key) for key in "hms")
    if "half" in parts and parts["half"].notna().any():
        late = (parts["half"].str.lower() == "p").to_numpy(dtype=bool)
        half = parts["half"].notna().to_numpy()
        hour = np.where(half, np.where(hour > 12, np.nan, hour % 12 + 12 * late), hour)
    fraction = np.zeros(len(parts))
    if "f" in parts and parts["f"].notna().any():
        fraction = pd.to_numeric("0." + parts["f"].fillna("0")).to_numpy(dtype=np.float64)
    right = (hour < 100 if "y" not in parts else hour < 24) & (minute < 60) & (second <= 60)
    return np.where(right, 3600 * hour + 60 * minute + second + fraction, np.nan)


def _zone(parts: pd.DataFrame) -> Array:
    """Return by how much the zone's time is ahead of UTC (N,) [s]."""
    import pandas as pd  # noqa: PLC0415, heavy

    if "zone" not in parts or parts["zone"].isna().all():
        return np.zeros(len(parts))
    signs = parts["zone"].str.extract(r"^([+-])(\d\d):?(\d\d)?$")
    ahead = 3600 * pd.to_numeric(signs[1]).fillna(0) + 60 * pd.to_numeric(signs[2]).fillna(0)
    return np.where(signs[0] == "-", -ahead, ahead).astype(np.float64)
