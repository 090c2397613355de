"""What a driver may be told by a site file: one model a driver, with the limits of each key; nothing unknown passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.errors import ConfigError, words
from drivers.local.names import guess, shown
from drivers.message import Message

Rule = tuple[str, bool, str | Message]
"""A key, whether its value is allowed beside the others, and what it must be."""
FIRST = "Value error, "
FILE_KEY = "site_file_kind"
"""Key of the schema that marks a text as a path: "secret" must be a readable file, "certificate" may come later."""
VariableText = Annotated[str, Field(json_schema_extra={FILE_KEY: "environment"})]
FilePathText = Annotated[str, Field(json_schema_extra={FILE_KEY: "secret"})]
CertificatePathText = Annotated[str, Field(json_schema_extra={FILE_KEY: "certificate"})]
FolderPathText = Annotated[str, Field(json_schema_extra={FILE_KEY: "folder"})]
BAUD_RATES = (9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600, 1_000_000, 2_000_000)
WIRES = ("tcp", "socket", "usb", "memory", "")
"""What `drivers.transport` opens."""

SPEED_KEYS = ("max_fringe_hz", "max_speed_mm_s", "max_speed_deg_s")
"""Keys by which a site states how fast a counting device follows a motion."""


@dataclass(frozen=True, slots=True)
class SettingFault:
    """One key that is wrong: ``key`` as it stands under settings, ``code`` of the catalogue and its fields.

    ``between``: each key is right by itself, and they do not go together.
    """

    key: str
    code: str
    fields: Mapping[str, Any]
    between: bool = False

    def error(self, where: str) -> ConfigError:
        """The fault as an exception."""
        return ConfigError(self.code, where, **self.fields)


class DriverSettings(BaseModel):
    """A driver's own keys of the site file, each with a default, its unit in its name, and a description.

    A text is no number and true is no 1; a whole number will do for a float; nothing is infinite.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        hide_input_in_errors=True,
        str_max_length=1000,
    )
    addresses: ClassVar[tuple[str, ...]] = ()
    sources: ClassVar[str] = ""
    """Kinds of url that the driver opens, by scheme; "" is a serial port's own name; none named: any."""
    typed: ClassVar[bool] = False
    """Whether a person types the readings: of whatever the person reads."""

    def speed_doubt(self) -> Rule:
        """A doubt about a counting device of which nobody said how fast it follows: no feed is compared with that."""
        keys = [key for key in SPEED_KEYS if key in type(self).model_fields]
        return keys[0], self.states_speed, words("W-KEY-SPEED-OPEN", keys=", ".join(keys))

    counts_motion: ClassVar[bool] = False
    """Whether the device follows a motion by counting, so that beyond a speed it loses some of it."""

    @property
    def states_speed(self) -> bool:
        """Whether the site says what the device follows, or that it is not known (0)."""
        return not self.model_fields_set.isdisjoint(SPEED_KEYS)

    @property
    def followed_feed_deg_min(self) -> float | None:
        """The greatest feed, deg/min, of a turning axis that the device's counter follows; None where not stated."""
        return None

    @property
    def followed_feed_mm_min(self) -> float | None:
        """The greatest feed, mm/min, that the instrument counts without loss; None: none that it declares."""
        return None

    @classmethod
    def read(cls, settings: Mapping[str, Any], where: str) -> Self:
        """The settings as a record. Raises ConfigError (E-CFG-SETTING, E-CFG-SETTING-VALUE) for the first fault."""
        for fault in cls.faults(settings):
            raise fault.error(where)
        return cls.model_validate(dict(settings))

    @classmethod
    def faults(cls, settings: Mapping[str, Any]) -> tuple[SettingFault, ...]:
        """Everything that is wrong with these settings; () is in order. Rules between keys hold for the right ones."""
        try:
            cls.model_validate(dict(settings))
        except ValidationError as error:
            found = [cls._fault(one) for one in error.errors(include_url=False, include_context=True)]
        else:
            found = []
        wrong = {fault.key.partition(".")[0] for fault in found}
        known = cls.model_validate({key: value for key, value in settings.items() if key not in wrong})
        rules = [(key, why) for key, good, why in known.rules() if not good and key not in wrong]
        broken = [_broken(key, why, between=True) for key, why in rules]
        return (*found, *broken)

    @classmethod
    def paths(cls) -> dict[str, str]:
        """Keys that hold a path, and its kind: secret, certificate or folder."""
        extras = {key: field.json_schema_extra for key, field in cls.model_fields.items()}
        return {
            key: str(extra[FILE_KEY]) for key, extra in extras.items() if isinstance(extra, dict) and FILE_KEY in extra
        }

    def rules(self) -> tuple[Rule, ...]:
        """What must hold between several keys; each on the key that is to be corrected."""
        return ()

    def doubts(self) -> tuple[Rule, ...]:
        """What is allowed and seldom meant; each on the key that is to be looked at, and why."""
        return ()

    def unprotected(self, url: str) -> Message | None:
        """Why others on the network could read or change what passes on this connection; None where they cannot."""
        del url
        return None

    def excused(self) -> tuple[str, str]:
        """Who accepted a certificate of this road that was not valid then, and why; ("", "") where nobody did."""
        return "", ""

    @property
    def plans_together(self) -> int:
        """How many stop plans a person starts with one press; 0 where none is started by a program."""
        return 0

    @property
    def one_start(self) -> bool:
        """Whether one start leads through both halves of a push (`Capabilities.one_start`)."""
        return False

    @property
    def quantities(self) -> tuple[str, ...]:
        """Units of what an instrument so set up can read ("mm", "um", "deg", "arcsec"); () where the device knows."""
        return ()

    @property
    def machine_axes(self) -> tuple[str, ...]:
        """Every axis of the control, where the settings name them; else ()."""
        return ()

    @classmethod
    def _fault(cls, one: Mapping[str, Any]) -> SettingFault:
        key = ".".join(map(str, one["loc"]))
        if one["type"] == "extra_forbidden":
            known = tuple(cls.model_fields)
            fields = {"key": shown(key), "known": ", ".join(known) + guess(key, known)}
            return SettingFault(key, "E-CFG-SETTING", fields)
        return _broken(key, in_words(one))


def usual_rate(baudrate: int) -> Rule:
    """A doubt about a rate that no serial line has, with the nearest that one has."""
    nearest = min(BAUD_RATES, key=lambda rate: abs(rate - baudrate))
    return "baudrate", baudrate in BAUD_RATES, words("W-CFG-BAUD", nearest=nearest)


def _broken(key: str, why: str | Message, *, between: bool = False) -> SettingFault:
    return SettingFault(key, "E-CFG-SETTING-VALUE", {"key": shown(key), "why": why}, between)


PAIRS = 3
"""Values of the longest list that a key has of a fixed length: ends of a range, three directions."""
_KINDS = {
    "float_type": "W-CFG-NUMBER",
    "int_type": "W-CFG-WHOLE",
    "int_from_float": "W-CFG-WHOLE",
    "finite_number": "W-CFG-FINITE",
    "bool_type": "W-CFG-FLAG",
    "string_type": "W-CFG-TEXT",
    "path_type": "W-CFG-TEXT",
    "tuple_type": "W-CFG-LIST",
    "model_type": "W-CFG-SECTION",
    "dict_type": "W-CFG-SECTION",
    "mapping_type": "W-CFG-SECTION",
    "string_too_short": "W-CFG-NOT-EMPTY",
    "date_type": "W-CFG-DATE-KIND",
    "date_parsing": "W-CFG-DATE-KIND",
    "date_from_datetime_parsing": "W-CFG-DATE-KIND",
    "date_from_datetime_inexact": "W-CFG-DATE-KIND",
    "missing": "W-CFG-MISSING",
}


def in_words(one: Mapping[str, Any], given: object = "") -> str:
    """What a model has against one value, in the words of the catalogue; ``given`` is what stands in the file."""
    kind, limits = str(one["type"]), one.get("ctx") or {}
    if kind == "tuple_type" and isinstance(given, dict):
        return words("W-CFG-MANY", key=one["loc"][-1])
    if kind == "model_type" and isinstance(given, list) and all(isinstance(one, dict) for one in given):
        return words("W-CFG-ONE", key=one["loc"][-1])
    if kind in _KINDS:
        return words(_KINDS[kind])
    if kind == "literal_error":
        allowed = str(limits["expected"]).replace("'", '"')
        names = [name.strip('"') for name in allowed.replace(" or ", ", ").split(", ")]
        return words("W-CFG-ONE-OF", allowed=allowed) + guess(str(given), names)
    if kind == "greater_than":
        return words("W-CFG-ABOVE", limit=_plain(limits["gt"]))
    if kind == "greater_than_equal":
        return words("W-CFG-LEAST", limit=_plain(limits["ge"]))
    if kind == "less_than":
        return words("W-CFG-BELOW", limit=_plain(limits["lt"]))
    if kind == "less_than_equal":
        return words("W-CFG-MOST", limit=_plain(limits["le"]))
    if kind == "string_too_long":
        return words("W-CFG-LONG", most=limits["max_length"])
    if kind in ("too_long", "too_short") and limits.get("field_type") == "Tuple":
        return _counted(kind, limits)
    return str(one["msg"]).removeprefix(FIRST)


def _counted(kind: str, limits: Mapping[str, Any]) -> str:
    """Why a list has too few or too many values."""
    found, most = limits["actual_length"], limits.get("max_length", 0)
    if found == 0:
        return words("W-CFG-NONE-GIVEN")
    if kind == "too_long" and most > PAIRS:
        return words("W-CFG-COUNT-MOST", most=most, found=found)
    return words("W-CFG-COUNT", least=limits.get("min_length", most), found=found)


def _plain(limit: Any) -> str:
    return f"{limit:.12g}" if isinstance(limit, float) else str(limit)
