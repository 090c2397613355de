"""What the models of a site file say against a tree, in words: unknown and missing keys, kinds, limits."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from drivers import registry
from drivers.errors import words
from drivers.local.names import closest, guess, shown
from drivers.local.scrub import has_user, is_secret
from drivers.message import Message
from drivers.settings import in_words
from gateway.config.faults import Fault, Path, place_name, value_at
from gateway.config.sections import AxisSection, MeasureSection, SiteFile, TableSection
from gateway.siteplan import MOST_TARGETS, SetupSection, Targets, WorkingWindow

_PATTERNS = {
    "country": "W-CFG-COUNTRY",
    "syslog": "W-CFG-SYSLOG",
    "prefix": "W-CFG-TOPIC",
    "letter": "W-CFG-LETTER",
    "dresser_letter": "W-CFG-LETTER",
    "wheel_letter": "W-CFG-LETTER",
    "component": "W-CFG-COMPONENT",
    "name": "W-CFG-SITE-NAME",
    "number_prefix": "W-CFG-PREFIX",
    "work_side": "W-CFG-SIDE",
    "tool_side": "W-CFG-SIDE",
}


# What people call a key.
_CALLED = {
    "url": ("address", "host", "ip", "port", "hostname"),
    "driver": ("type", "model", "protocol"),
    "travel": ("range", "limits", "stroke", "min", "max", "low", "high", "lower", "upper"),
    "minimum": ("min", "low", "lower", "start", "first", "from"),
    "maximum": ("max", "high", "upper", "end", "last", "to"),
    "feed": ("speed", "velocity", "feedrate"),
    "repetitions": ("runs", "cycles", "repeats"),
    "step": ("interval", "spacing", "pitch"),
    "first": ("start", "from", "min", "low"),
    "last": ("end", "to", "max", "high"),
    "count": ("points", "number", "steps"),
    "component": ("error", "motion"),
    "name": ("id", "machine"),
}
# Keys of a section whose own keys are names, not keys that we know.
_NAMED_BY_PEOPLE = ("settings", "park", "safe", "limits")
# Where a rule of a whole section stands in it.
_MEANT: dict[type[BaseModel] | None, Path] = {
    AxisSection: ("travel",),
    TableSection: ("step",),
    WorkingWindow: ("step",),
    Targets: ("count",),
}


def key_faults(tree: Mapping[str, Any]) -> tuple[SiteFile | None, tuple[Fault, ...]]:
    """The site if the models have nothing against the tree, and every fault they find."""
    try:
        return SiteFile.model_validate(tree), ()
    except ValidationError as error:
        told = [one for one in error.errors(include_url=False) if not _is_short_by_others(tree, one)]
        return None, tuple(_each_once(_fault(tree, one) for one in told))


def _is_short_by_others(tree: Any, one: Mapping[str, Any]) -> bool:
    """Whether a list of sections is called too short only because those in it have faults of their own."""
    section = value_at(tree, one["loc"])
    return one["type"] == "too_short" and isinstance(section, list) and len(section) >= one["ctx"]["min_length"]


def _each_once(found: Iterable[Fault]) -> Iterator[Fault]:
    """One fault a place: each kind that a key may have complains, and what is mistyped is not missing too."""
    faults = tuple(found)
    seen: set[Path] = {_suggested_place(fault.path) for fault in faults if fault.on_key}
    for fault in faults:
        if fault.path not in seen:
            seen.add(fault.path)
            yield fault


def _fault(tree: Mapping[str, Any], one: Mapping[str, Any]) -> Fault:
    path = _in_tree(one["loc"])
    if one["type"] == "extra_forbidden":
        known = sorted(model.model_fields) if (model := model_at(path[:-1])) is not None else []
        fields = {
            "key": shown(place_name(tree, path)),
            "known": ", ".join(known) + _suggested_key(str(path[-1]), known),
        }
        return Fault(path, "E-CFG-KEY", fields, on_key=True)
    if one["type"] == "missing" and path and isinstance(path[-1], int):
        path = path[:-1]
    if one["type"] == "value_error":
        model = model_at(path)
        path += _MEANT.get(model, ()) or _missing_key(model, value_at(tree, path))
    return broken_rule(tree, path, _why(tree, path, one))


def _missing_key(model: type[BaseModel] | None, section: Any) -> Path:
    """The key that a section lacks beside those it has, as its own rule says."""
    if model is MeasureSection:
        wanted: tuple[str, ...] = ("file_datum",) if "file" in section else ("instrument", "targets")
    elif model is SetupSection:
        by_source = {"live": ("instrument",), "file": ("path", "datum"), "none": ("assumed",)}
        wanted = by_source.get(section.get("source", "live"), ())
    else:
        return ()
    return tuple(key for key in wanted if section.get(key) in (None, ""))[:1]


def _suggested_key(key: str, known: list[str]) -> str:
    """What a key that a section has not was probably to be: another one of it, or the same one of another section."""
    meant = next((name for name, called_so in _CALLED.items() if key.lower() in called_so and name in known), "")
    if meant:
        return words("W-CFG-GUESS", word=meant)
    if key in SiteFile.model_fields:
        many = is_list(SiteFile.model_fields[key].annotation)
        return words("W-CFG-ELSEWHERE", places=f"[[{key}]]" if many else f"[{key}]")
    there = sorted(name for name, keys in _sections().items() if key in keys)
    return guess(key, known) or (words("W-CFG-ELSEWHERE", places=", ".join(there)) if there else "")


@cache
def _sections() -> dict[str, tuple[str, ...]]:
    """The keys of every section, by its header; those of a driver's settings among them."""
    found: dict[str, tuple[str, ...]] = {}

    def add(name: str, model: type[BaseModel], *, many: bool) -> None:
        found[f"[[{name}]]" if many else f"[{name}]"] = tuple(model.model_fields)
        for key, field in model.model_fields.items():
            if (inner := section_of(field.annotation)) is not None:
                add(f"{name}.{key}", inner, many=is_list(field.annotation))

    for key, field in SiteFile.model_fields.items():
        if (inner := section_of(field.annotation)) is not None:
            add(key, inner, many=is_list(field.annotation))
    for role, name in (
        ("controller", "[controller.settings]"),
        ("instrument", "[instrument.settings]"),
    ):
        models = [spec.load_settings() for spec in registry.known(role).values()]
        found[name] = tuple(key for model in models if model is not None for key in model.model_fields)
    return found


def _suggested_place(path: Path) -> Path:
    """The place that a mistyped key was to have; its own where nobody knows."""
    model = model_at(path[:-1])
    close = closest(str(path[-1]), model.model_fields) if model is not None else ""
    return (*path[:-1], close) if close else path[:-1]


def broken_rule(tree: Any, path: Path, why: str | Message, *, doubt: bool = False) -> Fault:
    """A value that may not be: the key by its section's name, the value where it may be shown, and why."""
    code = "W-CFG-DOUBT" if doubt else "E-CFG-VALUE"
    return Fault(
        path, code, {"key": shown(place_name(tree, path)), "value": _given_value(tree, path), "why": why}, doubt=doubt
    )


def _given_value(tree: Any, path: Path) -> str:
    """The value that was refused, as far as it is one and may be shown."""
    value = value_at(tree, path)
    hidden = has_user(str(value)) or any(is_secret(str(part)) for part in path)
    if hidden or not isinstance(value, str | int | float):
        return ""
    return f' = "{shown(value)}"' if isinstance(value, str) else f" = {shown(value).lower()}"


def _in_tree(loc: tuple[Any, ...]) -> Path:
    """A place without the names that pydantic gives to the kinds of one key, and to keys of a mapping."""
    path: Path = ()
    for part in loc:
        model = model_at(path)
        if part == "[key]" or (model is None and isinstance(part, str) and path and path[-1] not in _NAMED_BY_PEOPLE):
            break
        path += (part,)
    return path


def _why(tree: Any, path: Path, one: Mapping[str, Any]) -> str:
    key, kind, given = path[-1] if path else "", one["type"], value_at(tree, path)
    needed = _needed_length(path)
    if path[:2] == ("moves", "safe") and len(path) == 3 and kind in ("tuple_type", "literal_error"):
        return words("W-CFG-PLACE-KIND") + guess(str(given).lower(), ("any",))
    if needed and kind == "tuple_type":
        return words("W-CFG-LIST-OF", least=needed)
    if needed and isinstance(given, list) and kind == "missing":
        return words("W-CFG-SHORT", least=needed, found=len(given))
    pattern = _PATTERNS.get(str(next((part for part in reversed(path) if isinstance(part, str)), "")))
    if kind == "string_pattern_mismatch" and pattern:
        return words(pattern)
    if key == "count" and kind != "value_error":
        return words("W-CFG-TARGET-COUNT", most=MOST_TARGETS)
    return in_words(one, given)


def _needed_length(path: Path) -> int:
    """How many values a list at a place of the tree must have; 0 where any number will do, or it is none."""
    for end in range(len(path), 0, -1):
        model = model_at(path[: end - 1])
        if model is not None:
            field = model.model_fields.get(str(path[end - 1]))
            return _length(field.annotation) if field is not None else 0
    return 0


def _length(annotation: Any) -> int:
    parts = get_args(annotation)
    if get_origin(annotation) is tuple:
        return 0 if Ellipsis in parts else len(parts)
    return next((found for one in parts if (found := _length(one))), 0)


def model_at(path: Path) -> type[BaseModel] | None:
    """The model of the section at a place of the tree; None where a value stands."""
    model: type[BaseModel] | None = SiteFile
    for part in path:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part) if model is not None else None
        model = section_of(field.annotation) if field is not None else None
    return model


def section_of(annotation: Any) -> type[BaseModel] | None:
    """The model in an annotation, through None and lists; None where there is none."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for one in get_args(annotation) if (found := section_of(one)) is not None), None)


def is_list(annotation: Any) -> bool:
    """Whether an annotation is a list of sections."""
    return section_of(annotation) is not None and getattr(annotation, "__origin__", None) is tuple


LISTS = tuple(name for name, field in SiteFile.model_fields.items() if is_list(field.annotation))
"""Sections of which there can be several."""


# A tree as far as it is right: every section as attributes, None where a key is wrong or left out.


def readable_section(model: type[BaseModel], raw: Any, wrong: Collection[Path], path: Path = ()) -> Any:
    """The section at ``path``, which stands in it as ``place`` so that a rule can say where it broke.

    A value is as it stands in the file: lists are lists. What is left out has its default.
    """
    given = raw if isinstance(raw, Mapping) else {}
    found = SimpleNamespace(place=path)
    for name, field in model.model_fields.items():
        place = (*path, name)
        inner = section_of(field.annotation)
        value = given.get(name)
        if inner is not None and is_list(field.annotation):
            value = [readable_section(inner, one, wrong, (*place, number)) for number, one in _readable_list(value)]
        elif name not in given:
            value = None if field.is_required() else field.get_default(call_default_factory=True)
        elif inner is not None and value is not None:
            value = readable_section(inner, value, wrong, place) if isinstance(value, Mapping) else None
        elif any(one[: len(place)] == place for one in wrong):
            value = None
        setattr(found, name, value)
    return found


def _readable_list(value: Any) -> list[tuple[int, Any]]:
    """The sections of a list, with their numbers."""
    found = value if isinstance(value, list) else []
    return [(number, one) for number, one in enumerate(found) if isinstance(one, Mapping)]
