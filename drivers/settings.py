"""What a driver may be told by a site file: one model a driver, with the limits of each key; nothing unknown passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.errors import ConfigError
from drivers.local.names import guess, shown

Rule = tuple[str, bool, str]
"""A key, whether its value is allowed beside the others, and what it must be."""
FIRST = "Value error, "
FILE_KEY = "site_file_kind"
"""Key of the schema that marks a text as a path: "secret" must be a readable file, "certificate" may come later."""
FilePathText = Annotated[str, Field(json_schema_extra={FILE_KEY: "secret"})]
CertificatePathText = Annotated[str, Field(json_schema_extra={FILE_KEY: "certificate"})]
FolderPathText = Annotated[str, Field(json_schema_extra={FILE_KEY: "folder"})]
WIRES = ("tcp", "socket", "usb", "memory", "")
"""What `drivers.transport` opens."""


@dataclass(frozen=True, slots=True)
class SettingFault:
    """One key that is wrong: ``key`` as it stands under settings, ``code`` of the catalogue and its fields."""

    key: str
    code: str
    fields: Mapping[str, Any]

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
    """Kinds of url that the driver opens, by scheme; "" is a serial port's own name; none named: any."""

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
        broken = [_broken(key, why) for key, good, why in known.rules() if not good and key not in wrong]
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

    @classmethod
    def _fault(cls, one: Mapping[str, Any]) -> SettingFault:
        key = ".".join(map(str, one["loc"]))
        if one["type"] == "extra_forbidden":
            known = tuple(cls.model_fields)
            fields = {"key": shown(key), "known": ", ".join(known) + guess(key, known)}
            return SettingFault(key, "E-CFG-SETTING", fields)
        return _broken(key, one["msg"].removeprefix(FIRST))


def _broken(key: str, why: str) -> SettingFault:
    return SettingFault(key, "E-CFG-SETTING-VALUE", {"key": shown(key), "why": why})
