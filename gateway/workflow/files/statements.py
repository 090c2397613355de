"""What a measured file states of machine, people, place, day and settings; compared with the site and between files.

One function for every command that takes files: a difference is shown to a person, or refused. Pure but for the memory
of what was accepted before.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from itertools import pairwise

from drivers.errors import ConfigError, words
from drivers.local.names import shown
from gateway.config import AxisSection, SiteFile, files_only
from gateway.domain.stated import AcceptedDifference, StatedFact, StatedFacts
from gateway.store import Maps
from gateway.workflow.files.headers import DATE, days_of, is_future

SITE = "site"
MOST_DAYS = 31
"""Files of one calibration are measured within a month; a larger difference is another calibration."""
OLDEST_DAYS = 366
"""What was measured longer ago says little of the machine of today: a certificate of it is one of the past."""
SAME = 0.01
"""Settings agree within one hundredth of their value: rounding."""
MEMORY, TODAY = "fact", "W-FACTS-TODAY"
_HEADINGS: Mapping[str, str] = {
    "machine": "machine, machine name, machine tool, machine type, maschine, maschinentyp, 机床, 机床型号, "
    "macchina, máquina",
    "serial": "serial no, serial number, serial, machine serial number, machine serial no, machine no, machine number, "
    "seriennummer, maschinennummer, masch-nr, 序列号, 机床编号, numéro de série, matricola",
    "operator": "by, operator, measured by, inspector, technician, bediener, prüfer, gemessen von, 操作员, 测量人, "
    "opérateur, operatore, operador",
    "place": "location, place, site, ort, standort, 地点, lieu, luogo, lugar",
    "date": DATE,
    "feed": "feed, feed rate, feedrate, vorschub, 进给, 进给速度, avance, avanzamento",
    "dwell": "dwell, dwell time, dwell period, verweilzeit, haltezeit, 停留时间, temporisation",
    "overrun": "overrun, over run, overtravel, überlauf, 越程",
    "instrument": "instrument, laser, laser head, laser system, interferometer, measuring device, "
    "measuring instrument, messgerät, messsystem, 仪器, 激光, 激光干涉仪",
    "instrument_serial": "instrument serial no, instrument serial number, laser serial no, laser serial number, "
    "laser sn, laser no, messgerät seriennummer, 仪器编号",
    "tables": "compensation, error compensation, acting tables, kompensation, 补偿",
    "warm_up": "warm-up, warm up, warmup, warmlauf, 预热",
    "customer": "customer, client, kunde, 客户",
    "order": "order, order no, order number, job no, auftrag, auftragsnummer, 订单号",
}
KEYS = tuple(_HEADINGS)
_KEY_OF = {word: key for key, words in _HEADINGS.items() for word in words.split(", ")}
# Sections of capture programs whose "Serial" is that of the instrument.
_EQUIPMENT = ("equipment", "instrument", "laser")
_NOTHING = {"", "-", "--", "---", "n/a", "none", "unknown", "?"}
_TOKENS = re.compile(r"[^\W_]+")
_PAIR = re.compile(r"\s*([^:=]{2,40}?)\s*[:=]\s*(\S.*)")
_QUANTITY = re.compile(r"\s*F?\s*([0-9]+(?:[.,][0-9]+)?)\s*([^\W\d].*|°.*)?\Z", re.IGNORECASE)
# To mm/min or deg/min, s, mm or deg.
_FEEDS = {"mm/min": 1.0, "mm/s": 60.0, "m/min": 1000.0, "m/s": 60000.0, "deg/min": 1.0, "deg/s": 60.0, "rpm": 360.0}
_FEEDS |= {"°/min": 1.0, "°/s": 60.0, "grad/min": 1.0, "1/min": 360.0, "in/min": 25.4, "inch/min": 25.4, "ipm": 25.4}
_UNITS: Mapping[str, Mapping[str, float]] = {
    "feed": _FEEDS,
    "dwell": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "min": 60.0, "秒": 1.0},
    "overrun": {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "deg": 1.0, "°": 1.0, "in": 25.4, "inch": 25.4},
}
UNIT_OF: Mapping[str, str] = {"feed": "{}/min", "dwell": "s", "overrun": "{}"}
_OF_AXIS = ("feed", "dwell", "overrun")


@dataclass(frozen=True, slots=True)
class FileFacts:
    """A file by its name in the report, the axis that it names ("" for none), and what it states by key."""

    name: str
    axis: str = ""
    said: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Difference:
    """What ``file`` states under ``key``, and what ``source`` ("site", or the name of a file) has instead."""

    file: str
    key: str
    value: str
    other: str
    source: str

    @property
    def text(self) -> str:
        """As a person types it to accept it: "machine=Mill 7"."""
        return f"{self.key}={self.value}"


Ask = Callable[[Difference], bool]
"""Shows one difference to a person; true where the file belongs here all the same."""


def facts_of(name: str, header: Mapping[str, str]) -> FileFacts:
    """What a file's header states; a key without a value is not stated."""
    found: dict[str, str] = {}
    for heading, text in header.items():
        plain = _plain(heading)
        lines = text.splitlines()
        if plain in _EQUIPMENT and (len(lines) > 1 or _PAIR.match(text)):
            for line in lines:
                _of_equipment(line, found)
        elif (key := _KEY_OF.get(plain)) is not None and _plain(text) not in _NOTHING:
            found.setdefault(key, shown(" ".join(text.split()))[:200])
    return FileFacts(name, header.get("Axis", "").strip(), {key: found[key] for key in KEYS if key in found})


def _of_equipment(line: str, found: dict[str, str]) -> None:
    pair = _PAIR.match(line)
    if pair is None or _plain(pair[2]) in _NOTHING:
        return
    key = _KEY_OF.get(_plain(pair[1]))
    key = {"serial": "instrument_serial", "machine": "instrument"}.get(key or "", key)
    if key in ("instrument", "instrument_serial"):
        found.setdefault(key, shown(" ".join(pair[2].split()))[:200])


def _plain(text: str) -> str:
    return " ".join(text.replace("_", " ").lower().strip(" .:#").split())


# -------------------------------------------------------------------------------------------------------- quantities


def quantity(key: str, text: str) -> float | None:
    """A setting in mm/min or deg/min, s, mm or deg; None for a text without a number or without a known unit."""
    found = _QUANTITY.match(text)
    if found is None or key not in _UNITS:
        return None
    unit = (found[2] or "").strip().lower().replace(" ", "").rstrip(".")
    factor = _UNITS[key].get(unit)
    return None if factor is None else float(found[1].replace(",", ".")) * factor


# --------------------------------------------------------------------------------------------------------- comparing


def differences(
    files: Sequence[FileFacts], site: SiteFile | None = None, today: date | None = None, *, recent: bool = True
) -> tuple[Difference, ...]:
    """Every statement that differs from the site's, or where the site has none, from that of most files.

    With ``today`` a date that is still to come differs from it; beside a site, whose machine is judged, so does one of
    more than a year ago, unless dates need not be ``recent``.
    """
    found: list[Difference] = []
    for key in KEYS:
        left: list[FileFacts] = []
        for one in files:
            if key not in one.said:
                continue
            known = _site_values(key, one, site)
            if known and not any(_same(key, one.said[key], text) for text in known):
                found.append(Difference(one.name, key, one.said[key], " / ".join(dict.fromkeys(known)), source=SITE))
            elif not known:
                left.append(one)
        found += _differences_across_files(key, left)
        found += _too_early(left, site) if key == "date" and site is not None else ()
        found += (
            _implausible_dates(left, today, old=recent and site is not None)
            if key == "date" and today is not None
            else ()
        )
    return tuple(dict.fromkeys(found))


def _differences_across_files(key: str, files: Sequence[FileFacts]) -> Iterator[Difference]:
    """Each file whose value is not that of most files; settings are compared between files of one axis only."""
    groups: dict[str, list[list[FileFacts]]] = {}
    for one in files:
        axis = one.axis.upper()
        if key in _OF_AXIS and not axis:
            continue
        alike = groups.setdefault(axis if key in _OF_AXIS else "", [])
        own = next((group for group in alike if _same(key, one.said[key], group[0].said[key])), None)
        if own is None:
            alike.append([one])
        else:
            own.append(one)
    for alike in groups.values():
        usual = max(alike, key=len)[0]
        others = (one for group in alike if group[0] is not usual for one in group)
        yield from (Difference(one.name, key, one.said[key], usual.said[key], source=usual.name) for one in others)


def _too_early(files: Sequence[FileFacts], site: SiteFile) -> Iterator[Difference]:
    """Dates before the machine was built, or before the calibration that the site's register states."""
    for one in files:
        last = days_of(one.said["date"]).last
        if last is None:
            continue
        year = site.machine.year
        later = [
            f"{item.name}: calibrated {item.calibrated}" for item in site.equipment if _is_after(item.calibrated, last)
        ]
        built = [f"built {year}"] if year is not None and last.year < year else []
        if built or later:
            yield Difference(one.name, "date", one.said["date"], ", ".join(built + later), source=SITE)


def _implausible_dates(files: Sequence[FileFacts], today: date, *, old: bool) -> Iterator[Difference]:
    """Dates after tomorrow (a clock that is wrong, or day and month exchanged), and ``old`` ones; a day for time zones.

    A date with several readings is far where each of them is.
    """
    for one in files:
        days = days_of(one.said["date"])
        past = old and days.last is not None and days.last < today - timedelta(days=OLDEST_DAYS)
        if past or is_future(one.said["date"], today):
            yield Difference(one.name, "date", one.said["date"], today.isoformat(), source=words(TODAY))


def _is_after(day: date | None, last: date) -> bool:
    return day is not None and day > last


def _site_values(key: str, one: FileFacts, site: SiteFile | None) -> tuple[str, ...]:
    """What the site has under a key; none where it states nothing."""
    if site is None:
        return ()
    axis = site.meant(one.axis)
    own = site.machine
    report = site.report
    found: Mapping[str, tuple[str, ...]] = {
        "machine": (site.site.name, f"{own.maker} {own.type}", f"{own.maker} {own.type} {own.number}", own.type),
        "serial": (own.number, "" if files_only(site) else site.controller.serial),
        "operator": (report.operator,),
        "place": (report.place,),
        "customer": (report.customer,),
        "order": (report.order,),
        "instrument": _instruments(site),
        "instrument_serial": (*(item.serial for item in site.instruments), *(item.serial for item in site.equipment)),
    }
    if key in _OF_AXIS:
        return _settings(key, axis, site)
    return tuple(text for text in (one.strip() for one in found.get(key, ())) if text)


def _instruments(site: SiteFile) -> tuple[str, ...]:
    """Equipment by maker, type and serial number; nothing where the register is empty: a name there is no statement."""
    return tuple(f"{one.name} {one.maker} {one.type} {one.serial}" for one in site.equipment)


def _settings(key: str, axis: AxisSection | None, site: SiteFile) -> tuple[str, ...]:
    """Feed, dwell or overrun of an axis: as the site states it for files, else as the site measures the axis itself."""
    if axis is None:
        return ()
    name = {"dwell": "dwell_s"}.get(key, key)
    for one in (*site.test_conditions, axis.measure):
        value = getattr(one, name)
        if value is not None and getattr(one, "axis", axis.name) in ("", axis.name):
            return (f"{value:g} {UNIT_OF[key].format(axis.unit)}",)
    return ()


def _same(key: str, value: str, other: str) -> bool:
    if key == "date":
        return days_of(value).apart(days_of(other)) <= MOST_DAYS
    if key in _OF_AXIS:
        one, two = quantity(key, value), quantity(key, other)
        if one is not None and two is not None:
            return abs(one - two) <= SAME * max(abs(one), abs(two))
    if key in ("serial", "instrument_serial"):
        return _number(value) == _number(other)
    return _words_agree(_tokens(value), _tokens(other))


def _number(text: str) -> str:
    """A serial number without its marks, its title and leading zeros."""
    return "".join(token for token in _tokens(text) if token not in ("sn", "no", "nr", "serial")).lstrip("0")


def _tokens(text: str) -> tuple[str, ...]:
    return tuple(_TOKENS.findall(text.casefold().replace("ß", "ss")))


def _words_agree(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """Whether a text names the same as another: every word of the shorter one is in the longer, or its initial.

    A number of ``one`` that the other lacks is another thing; a number alone names nothing. Words run together
    ("XL80", "XL-80") agree too.
    """
    joined = {*other, *("".join(pair) for pair in pairwise(other)), "".join(other)}
    if "".join(one) in joined:
        return True
    if any(token not in joined and any(letter.isdigit() for letter in token) for token in one):
        return False
    short, long = sorted((one, other), key=len)
    if not any(token.isalpha() for token in short):
        return False
    return all(token in long or (len(token) == 1 and any(word.startswith(token) for word in long)) for token in short)


# ---------------------------------------------------------------------------------------------------------- settling


def settle(
    files: Sequence[FileFacts],
    site: SiteFile | None,
    *,
    maps: Maps | None = None,
    accepted: Sequence[str] = (),
    ask: Ask | None = None,
    utc: datetime | None = None,
    recent: bool = True,
) -> StatedFacts:
    """Compare, ask about what differs, remember what a person accepted for this site, and return it all as a record.

    ``accepted`` are KEY=VALUE as `Difference.text` has them; without ``recent`` past dates may be of any age. Raises
    ConfigError: E-FACTS-ACCEPT for a word that is no statement, E-FACTS-DIFFER where nobody can be asked, E-FACTS-OTHER
    where a person says that a file is another's.
    """
    for word in accepted:
        if word.partition("=")[0].strip() not in KEYS or not word.partition("=")[2].strip():
            raise ConfigError("E-FACTS-ACCEPT", "--accept", text=shown(word), known=", ".join(KEYS))
    stamp = utc.isoformat(timespec="seconds") if utc is not None else ""
    given = {_normal(word) for word in accepted}
    found = differences(files, site, utc.date() if utc is not None else None, recent=recent)
    settled: dict[Difference, str] = {}
    for one in found:
        when = _is_remembered(one, site, maps)
        if when is None and _normal(one.text) in given:
            when = _remember(one, site, maps, stamp)
        if when is not None:
            settled[one] = when
    settled = _ask_person(
        [one for one in found if one not in settled], settled, ask, lambda one: _remember(one, site, maps, stamp)
    )
    return StatedFacts(
        tuple(StatedFact(one.name, key, value) for one in files for key, value in one.said.items()),
        tuple(
            AcceptedDifference(one.file, one.key, one.value, one.other, source=one.source, utc=settled[one])
            for one in found
        ),
    )


@dataclass(frozen=True, slots=True)
class StatementComparison:
    """With what the statements of files are compared, and who is asked about a difference.

    One command has one: ``earlier`` are the files that it took so far, with which each further one is compared. Dates
    must be ``recent`` by the clock ``utc``; those of a collection need not, but none is still to come.
    """

    site: SiteFile | None = None
    accepted: Sequence[str] = ()
    ask: Ask | None = None
    utc: Callable[[], datetime] | None = None
    recent: bool = True
    earlier: list[FileFacts] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Whose runs are made of the files."""
        return self.site.site.name if self.site is not None else "import"

    def settled(
        self, files: Sequence[FileFacts], maps: Maps | None, utc: Callable[[], datetime] | None = None
    ) -> StatedFacts:
        """See `settle`; what is returned is of these files alone, and the next ones are compared with them too."""
        clock = utc or self.utc
        now = clock() if clock is not None else None
        both = [*(one for one in self.earlier if one not in files), *files]
        found = settle(both, self.site, maps=maps, accepted=self.accepted, ask=self.ask, utc=now, recent=self.recent)
        self.earlier[:] = both
        names = {one.name for one in files}
        return StatedFacts(
            tuple(one for one in found.facts if one.file in names),
            tuple(one for one in found.accepted if one.file in names),
        )


def _ask_person(
    left: Sequence[Difference], settled: Mapping[Difference, str], ask: Ask | None, keep: Callable[[Difference], str]
) -> dict[Difference, str]:
    if left and ask is None:
        raise refusal(left)
    found = dict(settled)
    texts: dict[str, str] = {}
    for one in left:
        if ask is not None and one.text not in texts:
            if not ask(one):
                source = words("W-FACTS-SITE") if one.source == SITE else one.source
                raise ConfigError(
                    "E-FACTS-OTHER", one.file, key=one.key, value=one.value, source=source, other=one.other
                )
            texts[one.text] = keep(one)
        found[one] = texts[one.text]
    return found


def refusal(left: Sequence[Difference]) -> ConfigError:
    """The error that names every difference and how each is accepted."""
    named = {SITE: words("W-FACTS-SITE")}
    lines = "\n".join(
        f"  {shown(one.file)}: {one.key} {one.value!r}, but {named.get(one.source, one.source)} {one.other!r}"
        for one in left
    )
    accept = " ".join(dict.fromkeys(f'--accept "{one.text}"' for one in left))
    return ConfigError("E-FACTS-DIFFER", shown(left[0].file), count=len(left), lines=lines, accept=accept)


def _normal(word: str) -> str:
    key, _, value = word.partition("=")
    return f"{key.strip()}={' '.join(value.split())}"


def _place(one: Difference, site: SiteFile | None) -> str:
    """Where an acceptance holds: at this site; without one, and for a day, between these values only.

    What is old today is so tomorrow: an old day is accepted once.
    """
    name = site.site.name if site is not None else ""
    alone = name and (one.key != "date" or one.source == words(TODAY))
    return f"{name} {one.text}" if alone else f"{name} {one.text} / {one.other}"


def _is_remembered(one: Difference, site: SiteFile | None, maps: Maps | None) -> str | None:
    found = maps.find(MEMORY, _place(one, site)) if maps is not None else None
    return found.utc if found is not None else None


def _remember(one: Difference, site: SiteFile | None, maps: Maps | None, utc: str) -> str:
    if maps is not None:
        maps.keep(MEMORY, _place(one, site), {"key": one.key, "value": one.value, "other": one.other}, utc)
    return utc


def settle_setup(
    file: FileFacts, site: SiteFile, before: StatedFacts, *, maps: Maps, accepted: Sequence[str], utc: datetime
) -> StatedFacts:
    """What a set-up's file states beside that of the run's earlier ones, compared with the site and with these.

    Nobody is asked in a run: raises ConfigError E-FACTS-SETUP for a difference that the set-up does not accept.
    """
    names = dict.fromkeys(one.file for one in before.facts if one.file != file.name)
    earlier = [FileFacts(name, "", before.of(name)) for name in names]
    try:
        found = settle([*earlier, file], site, maps=maps, accepted=accepted, utc=utc)
    except ConfigError as error:
        if error.code != "E-FACTS-DIFFER":
            raise
        lines, own = error.fields["lines"], differences([*earlier, file], site, utc.date())
        texts = ", ".join(dict.fromkeys(f'"{one.text}"' for one in own if one.file == file.name))
        raise ConfigError("E-FACTS-SETUP", error.where, lines=lines, accept=texts) from error
    known = dict.fromkeys((*before.accepted, *found.accepted))
    return StatedFacts(found.facts, tuple(known), before.conditions)
