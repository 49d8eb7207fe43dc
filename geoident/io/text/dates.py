"""Dates as field sheets have them: ISO unless another format is declared, never guessed.

A date is kept as seconds since 1970 of the clock that it was read from: construction sites live in
one time zone. An offset from UTC that a logger writes is read beside it (`utc_offset`); who knows
all dates of a file brings them to one clock.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime

ISO = "YYYY-MM-DD"
_TOKENS = {"YYYY": "%Y", "MM": "%m", "DD": "%d", "hh": "%H", "mm": "%M", "ss": "%S"}
_TOKEN = re.compile("|".join(_TOKENS))
_FORMAT = re.compile(r"(?:YYYY|MM|DD|hh|mm|ss|[-./: T])+")
_LONGEST = 40
_OFFSET = re.compile(r":\d{2}.*(?:[+-]\d{2}|[Zz])|T.*(?:[+-]\d{2}|[Zz])")
"""What can be an offset from UTC: behind a time of day."""


class DateError(ValueError):
    """A text that is not a date of the format."""


def format_problem(pattern: str) -> str | None:
    """Why a text is no date format, or None if it is one.

    >>> format_problem("DD.MM.YYYY hh:mm")
    >>> format_problem("DD.MM.YY")
    'a year has four digits: write YYYY'
    """
    if not _FORMAT.fullmatch(pattern):
        year = "YY" in pattern and "YYYY" not in pattern
        return (
            "a year has four digits: write YYYY"
            if year
            else "it is made of YYYY, MM, DD, hh, mm, ss and separators"
        )
    for token in ("YYYY", "MM", "DD"):
        if pattern.count(token) != 1:
            return f"{token} must occur in it once"
    twice = next((token for token in ("hh", "mm", "ss") if pattern.count(token) > 1), None)
    return f"{twice} occurs in it more than once" if twice else None


def read_date(text: str, pattern: str = ISO) -> float:
    """Seconds since 1970 of a date in a format of YYYY, MM, DD, hh, mm, ss.

    In the ISO format a time of day may follow.

    >>> read_date("1970-01-02"), read_date("02.01.1970 00:01", "DD.MM.YYYY hh:mm")
    (86400.0, 86460.0)

    Raises:
        DateError: it is none.
    """
    text = text.strip()
    if len(text) > _LONGEST or not text.isascii():
        raise DateError(f"found no date of the form {pattern}")
    try:
        if pattern == ISO:
            if not re.match(r"\d{4}-\d{2}-\d{2}", text):
                raise ValueError
            date = datetime.fromisoformat(text).replace(tzinfo=None)
        else:
            code = _TOKEN.sub(lambda match: _TOKENS[match[0]], pattern)
            date = datetime.strptime(text, code)
    except ValueError:
        raise DateError(f"'{text}' is not a date of the form {pattern}") from None
    return date.replace(tzinfo=UTC).timestamp()


_USUAL = ("YYYY-MM-DD", "DD.MM.YYYY", "DD/MM/YYYY", "MM/DD/YYYY", "DD-MM-YYYY", "YYYY/MM/DD")
_TIMES = ("", " hh:mm", " hh:mm:ss")


def date_hint(text: str, pattern: str, declaring: Callable[[str], str]) -> str:
    """What is to be done about a text that is no date of a format.

    >>> date_hint("31.02.2025", "DD.MM.YYYY", str)
    'There is no such day in the calendar: correct it, or date_format (day, month).'
    >>> date_hint("21.02.2025", "YYYY-MM-DD", "readings: {{file: ..., {}}}".format)
    'Declare how it is written: readings: {file: ..., date_format: DD.MM.YYYY}.'

    Args:
        text: that is none.
        pattern: the format.
        declaring: what a user writes to declare a key of the file.
    """
    text = text.strip()
    shape = re.escape(_TOKEN.sub(lambda match: "0" * len(match[0]), pattern))
    if re.fullmatch(shape.replace("0", r"\d"), text):
        return "There is no such day in the calendar: correct it, or date_format (day, month)."
    others = [day + time for day in _USUAL for time in _TIMES if _is_date(text, day + time)]
    forms = " or ".join(others) or "DD.MM.YYYY hh:mm"
    return f"Declare how it is written: {declaring(f'date_format: {forms}')}."


_STRFTIME = {"%Y": "YYYY", "%m": "MM", "%d": "DD", "%H": "hh", "%M": "mm", "%S": "ss"}


def from_strftime(text: str) -> str:
    """A date format of C, Python or R as it is written here; empty where it is none.

    >>> from_strftime("%d.%m.%Y %H:%M"), from_strftime("%b %y")
    ('DD.MM.YYYY hh:mm', '')
    """
    written = text.strip().strip("'\"")
    for code, token in _STRFTIME.items():
        written = written.replace(code, token)
    return "" if format_problem(written) else written


def day_and_month_exchanged(seconds: float) -> float | None:
    """A date whose day and month were mistaken for each other; None where that cannot be."""
    date = datetime.fromtimestamp(seconds, tz=UTC)
    return date.replace(month=date.day, day=date.month).timestamp() if date.day <= 12 else None


def exchanged_format(pattern: str) -> str:
    """A date format with day and month in each other's place.

    >>> exchanged_format("DD.MM.YYYY")
    'MM.DD.YYYY'
    """
    return pattern.replace("DD", "_").replace("MM", "DD").replace("_", "MM")


def _is_date(text: str, pattern: str) -> bool:
    try:
        read_date(text, pattern)
    except DateError:
        return False
    return True


def utc_offset(text: str) -> float | None:
    """Seconds by which the clock of an ISO date is ahead of UTC; None where it does not say.

    >>> utc_offset("2024-03-01T10:00+02:00"), utc_offset("2024-03-01 10:00Z")
    (7200.0, 0.0)
    >>> utc_offset("2024-03-01 10:00")
    """
    text = text.strip()
    if len(text) > _LONGEST or not _OFFSET.search(text):
        return None
    try:
        ahead = datetime.fromisoformat(text).utcoffset()
    except ValueError:
        return None
    return None if ahead is None else ahead.total_seconds()


def offset_text(seconds: float) -> str:
    """An offset from UTC as people write it.

    >>> offset_text(7200.0), offset_text(-12600.0)
    ('UTC+02:00', 'UTC-03:30')
    """
    minutes = round(abs(seconds) / 60.0)
    return f"UTC{'-' if seconds < 0.0 else '+'}{minutes // 60:02d}:{minutes % 60:02d}"


def date_text(seconds: float) -> str:
    """A date for messages, with the time of day where there is one.

    >>> date_text(86460.0)
    '1970-01-02 00:01'
    """
    date = datetime.fromtimestamp(round(seconds), tz=UTC)
    return date.strftime("%Y-%m-%d %H:%M").removesuffix(" 00:00")
