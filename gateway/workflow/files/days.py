"""Dates as result files write them: the days that a text can mean, and whether they are still to come; pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta

DATE = "date, measured on, test date, datum, messdatum, 日期, 测量日期, data, fecha"
"""Headings under which a file states its day."""
_MONTHS = (
    "jan, januar, january, janvier, gennaio, enero, jän, jänner",
    "feb, februar, february, février, fevrier, febbraio, febrero",
    "mar, mär, mrz, märz, maerz, march, mars, marzo",
    "apr, april, avril, aprile, abril",
    "may, mai, maggio, mayo",
    "jun, juni, june, juin, giugno, junio",
    "jul, juli, july, juillet, luglio, julio",
    "aug, august, août, aout, agosto",
    "sep, sept, september, septembre, settembre, septiembre",
    "oct, okt, oktober, october, octobre, ottobre, octubre",
    "nov, november, novembre, noviembre",
    "dec, dez, dezember, december, décembre, decembre, dicembre, diciembre",
)
_MONTH = {word: number for number, words in enumerate(_MONTHS, 1) for word in words.split(", ")}
NEWEST = 69
"""A year of two digits up to this one is in this century."""
_ISO = re.compile(r"(\d{4})[-/.年 ](\d{1,2})[-/.月 ](\d{1,2})日?(?!\d)")
_RUN_TOGETHER = re.compile(r"((?:19|20)\d\d)(\d\d)(\d\d)(?!\d)")
_NUMBERS = re.compile(r"(\d{1,2})([./-])\s?(\d{1,2})\2\s?(\d{4}|\d{2})(?!\d)")
_DAY_FIRST = re.compile(r"(\d{1,2})(?:st|nd|rd|th|er)?[. -]*([^\W\d_]+)[. ,-]*(\d{4})")
_MONTH_FIRST = re.compile(r"([^\W\d_]+)[. ]*(\d{1,2})(?:st|nd|rd|th)?[ ,]+(\d{4})")
_CLOCK = re.compile(r"([^\W\d_]+) +(\d{1,2}) +\d{1,2}:\d\d(?::\d\d)? +(\d{4})")
_YEAR = re.compile(r"((?:19|20)\d\d)\Z")


@dataclass(frozen=True, slots=True)
class Days:
    """The days that a text can mean: one span, or several where day and month may be exchanged; none if unreadable."""

    spans: tuple[tuple[date, date], ...] = ()

    @property
    def day(self) -> date | None:
        """The day, where the text means exactly one."""
        single = len(self.spans) == 1 and self.spans[0][0] == self.spans[0][1]
        return self.spans[0][0] if single else None

    @property
    def last(self) -> date | None:
        """The latest day that the text can mean."""
        return max((last for _first, last in self.spans), default=None)

    @property
    def first(self) -> date | None:
        """The earliest day that the text can mean."""
        return min((first for first, _last in self.spans), default=None)

    def apart(self, other: Days) -> int:
        """Least number of days between two dates, by every reading of them; 0 where one cannot be read."""
        found = [_between(one, two) for one in self.spans for two in other.spans]
        return min(found, default=0)


def _between(one: tuple[date, date], two: tuple[date, date]) -> int:
    return max(0, (two[0] - one[1]).days, (one[0] - two[1]).days)


def days_of(text: str) -> Days:
    """The days that a date means, in the forms of English, German, Chinese and other files, a time behind it or not.

    "3/4/2024" may be March or April, "2024" is any day of that year.
    """
    plain = text.strip().lower()
    if found := _ISO.match(plain) or _RUN_TOGETHER.match(plain):
        return _days([(found[1], found[2], found[3])])
    if found := _NUMBERS.search(plain):
        first, mark, second, year = found.groups()
        if len(year) == len("24"):
            year = f"{'19' if int(year) > NEWEST else '20'}{year}"
        orders = [(year, second, first)] if mark == "." else [(year, second, first), (year, first, second)]
        return _days(orders)
    if (found := _DAY_FIRST.search(plain)) and found[2] in _MONTH:
        return _days([(found[3], str(_MONTH[found[2]]), found[1])])
    if (found := _CLOCK.search(plain) or _MONTH_FIRST.search(plain)) and found[1] in _MONTH:
        return _days([(found[3], str(_MONTH[found[1]]), found[2])])
    if found := _YEAR.match(plain):
        return Days(((date(int(found[1]), 1, 1), date(int(found[1]), 12, 31)),))
    return Days()


def _days(orders: Sequence[tuple[str, str, str]]) -> Days:
    found = []
    for year, month, day in orders:
        try:
            one = date(int(year), int(month), int(day))
        except ValueError:
            continue
        found.append((one, one))
    return Days(tuple(dict.fromkeys(found)))


def moment_of(text: str) -> str:
    """A date as ISO 8601 where it means one day, with its time where that is ISO; "" where it does not."""
    day = days_of(text).day
    if day is None:
        return ""
    plain = text.strip()
    try:
        return plain if datetime.fromisoformat(plain) and plain.startswith(day.isoformat()) else day.isoformat()
    except ValueError:
        return day.isoformat()


def date_in(header: Mapping[str, str]) -> str:
    """What a file's header states as its day, "" for nothing."""
    known = DATE.split(", ")
    return next((text for key, text in header.items() if key.replace("_", " ").lower().strip(" .:#") in known), "")


def to_come(text: str, today: date) -> bool:
    """Whether a date means a day after tomorrow by every reading of it; a day for time zones."""
    first = days_of(text).first
    return first is not None and first > today + timedelta(days=1)
