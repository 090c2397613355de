"""A message: a code of the catalogue with its fields. Records, events and errors contain messages, never sentences.

Text is produced where a person reads it, by `render`, in that reader's language. A field may be a number, a name, a
`Quantity`, a `Moment`, another `Message` or a tuple of these, so a sentence within a sentence follows the language too.

Numbers have the decimal sign of the language: "0.35 µm", in German "0,35 µm". A text chooses between one and many by a
format of its own, ``{count:# target|# targets}``: the forms stand in the order of the language's plural categories in
CLDR, which for whole numbers are "one" and "other" in English and German, and "other" alone in Chinese. "#" is the
number. (Babel would bring the data of some hundred languages for one rule, which the page needs in a browser as well.)

``{said:prose}`` in a text sets several messages as sentences one after another.

As JSON a message is ``{"code": ..., "fields": {...}}``, with "form" and "where" where it has them; a quantity is
``{"value": ..., "unit": ...}``, a moment ``{"utc": ...}``. A text that an older version stored finished has no code.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from math import isfinite
from typing import Any

from drivers.catalogue import text_of
from drivers.terms import Coded, filled, shown

ENGLISH = "en"
_DECIMAL = {"de": ","}
_MANY = {"en": 2, "de": 2, "zh": 1}
_STORED = "text"


class Form(StrEnum):
    """How a message is shown: its text alone, behind its code, or as an error with place and what to do."""

    TEXT = "text"
    REASON = "reason"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with its unit ("" for none), e.g. 0.35 um; ``decimals`` None: as it is, six digits at most."""

    value: float
    unit: str = ""
    decimals: int | None = None
    signed: bool = False

    def __str__(self) -> str:
        return _written(self, ENGLISH, plain=False)

    def __float__(self) -> float:
        return self.value


@dataclass(frozen=True, slots=True)
class Moment:
    """A moment in UTC, as ISO 8601 text."""

    utc: str


@dataclass(frozen=True, slots=True)
class Message:
    """A code of the catalogue and what fills its text; ``where`` is the device, file or room of an error.

    Fields of any other type than the ones named above become text when the message is made.
    """

    code: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    form: Form = Form.TEXT
    where: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", {key: _field(value) for key, value in self.fields.items()})

    def __hash__(self) -> int:
        return hash((self.code, self.where, tuple(sorted(self.fields))))

    def __str__(self) -> str:
        return render(self)

    @classmethod
    def of(cls, code: str, /, **fields: object) -> Message:
        """A message by its code and fields."""
        return cls(code, fields)

    @classmethod
    def stored(cls, text: str) -> Message:
        """A finished text of an older version: shown as it was stored, in whatever language it was."""
        return cls("", {_STORED: text})

    def as_data(self) -> dict[str, Any]:
        """The message as JSON data."""
        data: dict[str, Any] = {"code": self.code, "fields": {key: _data(one) for key, one in self.fields.items()}}
        if self.form is not Form.TEXT:
            data["form"] = self.form.value
        return data | ({"where": self.where} if self.where else {})

    @classmethod
    def from_data(cls, data: object) -> Message:
        """The message that `as_data` wrote, or an older version's text. Raises ValueError for anything else."""
        if isinstance(data, str):
            return cls.stored(data)
        keys = {"code", "fields", "form", "where"}
        if not isinstance(data, Mapping) or not {"code", "fields"} <= set(data) or set(data) - keys:
            raise ValueError("a message has code and fields, and may have form and where")
        fields = {str(key): _from_data(one) for key, one in data["fields"].items()}
        return cls(str(data["code"]), fields, Form(data.get("form", Form.TEXT)), str(data.get("where", "")))


def render(message: Message, language: str = ENGLISH, *, plain: bool = False) -> str:
    """The text of a message in a language, English where that has none; ``plain`` leaves out codes and places.

    An unknown code shows its fields.
    """
    if not message.code:
        return str(message.fields.get(_STORED, ""))
    what = _text(message.code, "what", message.fields, language, plain=plain)
    if message.form is Form.TEXT:
        return what
    place = f" [{message.where}]" if message.where else ""
    head = what if plain else f"{message.code}{place}: {what}"
    if message.form is Form.REASON:
        return head
    todo = advice(message, language, plain=plain)
    return f"{head} -> {todo}" if todo else head


def advice(message: Message, language: str = ENGLISH, *, plain: bool = False) -> str:
    """What to do about it; "" where its text names nothing."""
    return _text(message.code, "do", message.fields, language, plain=plain) if text_of(message.code) else ""


def told(message: Message) -> dict[str, Any]:
    """The message for another program: code and fields, and its English text."""
    return {**message.as_data(), "text": render(message)}


def words(code: str, part: str = "what", /, **fields: object) -> str:
    """A catalogue text that is no error, in English: progress, findings, verdicts; units as people write them.

    Unknown codes show their fields.
    """
    return _text(code, part, fields, ENGLISH)


def fields_as_data(fields: Mapping[str, object]) -> dict[str, Any]:
    """Fields of a word of progress as JSON data, messages within them as code and fields."""
    return {str(key): _data(_field(value)) for key, value in fields.items()}


def fields_from_data(data: Mapping[str, Any]) -> dict[str, object]:
    """What `fields_as_data` wrote. Raises ValueError for a field that is none."""
    return {str(key): _from_data(value) for key, value in data.items()}


def term(said: str) -> Message | str:
    """A term of the control as a field or text: a message where it is one of the catalogue."""
    return Message(str(said)) if isinstance(said, Coded) else said


def fixed(value: float | None, decimals: int = 2, *, signed: bool = False) -> Quantity | str:
    """A number with so many decimals for a text that names its unit; "-" for what does not exist."""
    return "-" if value is None else Quantity(float(value), decimals=decimals, signed=signed)


def digits(value: float | None, count: int = 2, *, signed: bool = False) -> Quantity | str:
    """A number with so many digits that count, for a text that names its unit; "-" for what does not exist."""
    return "-" if value is None else Quantity(float(f"{value:.{count}g}"), signed=signed)


def prose(messages: Iterable[Message], language: str = ENGLISH, *, plain: bool = False) -> str:
    """Several sentences, one after another."""
    return ("" if language == "zh" else " ").join(render(one, language, plain=plain) for one in messages)


def joined(messages: tuple[Message, ...], language: str = ENGLISH, *, plain: bool = False) -> str:
    """Several messages in one line."""
    return _written(messages, language, plain=plain)


def _between(language: str, *, sentences: bool) -> str:
    """What stands between names, or between sentences."""
    if language == "zh":
        return "；" if sentences else "、"
    return "; " if sentences else ", "


def _text(code: str, part: str, fields: Mapping[str, object], language: str, *, plain: bool = False) -> str:
    entry = (None if language == ENGLISH else text_of(code, language)) or text_of(code)
    if entry is None:
        return f"{code} {dict(fields)}"
    return shown(entry.get(part, "").format_map(_Fields(fields, language, plain)), language)


class _Fields(dict[str, Any]):
    """The fields of one text, as its language writes them; a missing one is a term of the control or shows its name."""

    def __init__(self, fields: Mapping[str, object], language: str, plain: bool) -> None:
        super().__init__(fields)
        self._how = (language, plain)

    def __getitem__(self, key: str) -> object:
        if key in self:
            return _Written(self.get(key), *self._how)
        said = filled(key)
        return _Absent(key) if said is None else _Written(term(said), *self._how)


class _Written:
    """One field on its way into a text."""

    def __init__(self, value: Any, language: str, plain: bool) -> None:
        self.value = value
        self.language = language
        self.plain = plain

    def __format__(self, spec: str) -> str:
        if "#" in spec:
            return self._counted(spec)
        said = getattr(self.value, "message", None)
        value = said if isinstance(said, Message) else self.value
        if spec == "prose":
            several = value if isinstance(value, tuple) else (value,)
            return prose((one for one in several if isinstance(one, Message)), self.language, plain=self.plain)
        if isinstance(value, (Message, Quantity, Moment, tuple)):
            return _written(value, self.language, plain=self.plain)
        text = format(value, spec)
        return _decimal(text, self.language) if isinstance(value, float) else text

    def _counted(self, forms: str) -> str:
        number, unit = (self.value.value, self.value.unit) if isinstance(self.value, Quantity) else (self.value, "")
        text = _decimal(f"{number:g}", self.language)
        chosen = forms.split("|")[: _MANY.get(self.language, 2)][0 if number == 1 else -1]
        return chosen.replace("#", f"{text} {unit}".strip())

    def __str__(self) -> str:
        return format(self, "")

    def __repr__(self) -> str:
        return repr(self.value)


class _Absent:
    def __init__(self, key: str) -> None:
        self._key = key

    def __format__(self, _spec: str) -> str:
        return f"<{self._key}>"


_NUMBER = re.compile(r"(?<=\d)\.(?=\d)")


def _decimal(text: str, language: str) -> str:
    sign = _DECIMAL.get(language)
    return text if sign is None else _NUMBER.sub(sign, text)


def _written(value: Any, language: str, *, plain: bool) -> str:
    if isinstance(value, Message):
        return render(value, language, plain=plain)
    if isinstance(value, Moment):
        return value.utc
    if isinstance(value, tuple):
        told = [_written(one, language, plain=plain) for one in value]
        sentences = bool(value) and all(isinstance(one, Message) for one in value)
        return _between(language, sentences=sentences).join(told)
    if isinstance(value, Quantity):
        sign = "+" if value.signed else ""
        number = f"{value.value:{sign}g}" if value.decimals is None else f"{value.value:{sign}.{value.decimals}f}"
        return f"{_decimal(number, language)} {value.unit}".strip()
    return str(value)


def _field(value: object) -> object:
    """A field as a message keeps it: what has no stored form of its own becomes text."""
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, (str, bool, int, float, Message, Quantity, Moment)):
        return value
    if isinstance(value, (tuple, list)):
        return tuple(_field(one) for one in value)
    said = getattr(value, "message", None)
    if isinstance(said, Message):
        return said
    item = getattr(value, "item", None)  # a number of numpy
    return item() if callable(item) and getattr(value, "shape", None) == () else str(value)


def _data(value: Any) -> object:
    if isinstance(value, Message):
        return value.as_data()
    if isinstance(value, Quantity):
        more = {"decimals": value.decimals} if value.decimals is not None else {}
        return {"value": _number(value.value), "unit": value.unit, **more, **({"signed": True} if value.signed else {})}
    if isinstance(value, Moment):
        return {"utc": value.utc}
    if isinstance(value, tuple):
        return [_data(one) for one in value]
    return _number(value) if isinstance(value, float) else value


def _number(value: float) -> object:
    """JSON has no number that is none, and none without end."""
    return {"number": str(value)} if not isfinite(value) else value


def _from_data(data: Any) -> object:
    if isinstance(data, list):
        return tuple(_from_data(one) for one in data)
    if not isinstance(data, Mapping):
        return data
    if "code" in data:
        return Message.from_data(data)
    if set(data) == {"utc"}:
        return Moment(str(data["utc"]))
    if set(data) == {"number"}:
        return float(data["number"])
    if {"value", "unit"} <= set(data) <= {"value", "unit", "decimals", "signed"}:
        return Quantity(**{**data, "value": _from_data(data["value"])})
    raise ValueError(f"no field of a message: {sorted(data)}")
