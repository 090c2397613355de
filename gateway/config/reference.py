"""The site file described from its models, the drivers' settings among them: JSON schema and page of reference."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from drivers import registry
from drivers.settings import DriverSettings
from drivers.terms import shown
from gateway.config.connections import INSTRUMENTS
from gateway.config.model_faults import is_list, section_of
from gateway.config.sections import SiteFile

ROLES = {"ControllerSection": ("controller",), "InstrumentSection": INSTRUMENTS}
_INSIDE = "memory"  # wires within one process
_OURS = "drivers."
_LIMITS = {
    "exclusiveMinimum": "above {}",
    "minimum": "{} or more",
    "exclusiveMaximum": "below {}",
    "maximum": "{} at most",
}


def settings_models(role: str, *, ours: bool = False) -> dict[str, type[DriverSettings]]:
    """The model of each driver of a role that declares one, by the driver's name; with ``ours`` of no other package."""
    specs = sorted(registry.known(role).items())
    models = {name: spec.load_settings() for name, spec in specs if not ours or spec.target.startswith(_OURS)}
    return {name: model for name, model in models.items() if model is not None}


def schema() -> dict[str, Any]:
    """The site file's JSON schema; the settings of each driver hold where it is named."""
    whole = SiteFile.model_json_schema()
    for section, roles in ROLES.items():
        cases = []
        for name, model in (pair for role in roles for pair in settings_models(role).items()):
            place = f"Settings-{name}"
            whole["$defs"][place] = model.model_json_schema()
            then = {"properties": {"settings": {"$ref": f"#/$defs/{place}"}}}
            cases.append({"if": _names_driver(whole["$defs"][section], name), "then": then})
        whole["$defs"][section]["allOf"] = cases
    return whole


def _names_driver(section: Mapping[str, Any], driver: str) -> dict[str, Any]:
    """Where this driver is meant: named, or the one that a section without any has."""
    is_default = section["properties"]["driver"].get("default") == driver
    said = {"properties": {"driver": {"const": driver}}}
    return said if is_default else {**said, "required": ["driver"]}


SOURCES = (
    "<!-- source: ISO 230-1: edition 2012; ISO 230-2: edition 2014; ISO 1328-1: edition 2013; ISO 14253-1: edition "
    "2017; ISO 3166: country codes, part 1 -->"
)
"""Where what the descriptions of keys say of standards comes from; a test asks for each."""


def page() -> str:
    """The page of reference, in Markdown: every section with its keys, then every driver's settings."""
    lines = [
        "# The site file",
        "",
        "Every key of a site file, as `trueflank check` knows it; this page is written from the code by",
        "`trueflank docs schema --page`. Keys without a default must be given. Positions are the machine's",
        "coordinates. `trueflank init` writes a commented file, `examples/sites` holds five.",
        "",
        SOURCES,
        "",
        *_reference_section("", SiteFile),
        "# Settings of the drivers",
        "",
        "They stand under `settings` of the control or of an instrument. Paths are taken from the site file's folder.",
        "",
    ]
    for role in ("controller", *INSTRUMENTS):
        for name, model in settings_models(role, ours=True).items():
            kinds = ", ".join(
                f"`{kind}://`" if kind else "a serial port" for kind in model.addresses if kind != "memory"
            )
            lines += [
                f"## {name} ({role})",
                "",
                f"{_first_sentence(model)} Its `url` is {kinds}.",
                "",
                *_table(model),
                "",
            ]
            lines += [f"<!-- source: {model.sources} -->", ""] if model.sources else []
    return shown("\n".join(lines)).rstrip() + "\n"


def _reference_section(place: str, model: type[BaseModel]) -> Iterator[str]:
    if place:
        yield from (f"## {place}", "", _first_sentence(model), "", *_table(model), "")
    for name, field in model.model_fields.items():
        inner = section_of(field.annotation)
        if inner is not None:
            path = f"{place.strip('[]')}.{name}" if place else name
            yield from _reference_section(f"[[{path}]]" if is_list(field.annotation) else f"[{path}]", inner)


def _first_sentence(model: type[BaseModel]) -> str:
    return (model.__doc__ or "").strip().split("\n\n")[0].replace("\n    ", " ").replace("``", "`")


def _table(model: type[BaseModel]) -> list[str]:
    rows = ["| key | default | is | meaning |", "|---|---|---|---|"]
    properties = model.model_json_schema()["properties"]
    for name, field in model.model_fields.items():
        if section_of(field.annotation) is None:
            cells = (f"`{name}`", default_of(field), kind_of(properties[name]), field.description or "")
            rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return rows if len(rows) > 2 else []


def default_of(field: FieldInfo) -> str:
    """A key's default as it is written in a site file; "must be given" where there is none."""
    if field.is_required():
        return "must be given"
    value = field.get_default(call_default_factory=True)
    if value is None or value in ("", (), {}):
        return "left out"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(map(repr, value))}]`"
    return f"`{value!r}`" if isinstance(value, int | float) else f'`"{value}"`'


def kind_of(one: Mapping[str, Any]) -> str:
    """Kind and limits of a value by its JSON schema, in words."""
    if "anyOf" in one:
        return " or ".join(kind_of(part) for part in one["anyOf"] if part.get("type") != "null")
    if "enum" in one or "const" in one:
        allowed = one.get("enum", [one.get("const")])
        return ", ".join(f'"{value}"' if isinstance(value, str) else str(value) for value in allowed if value != "")
    kinds = {"number": "number", "integer": "whole number", "boolean": "true or false", "string": "text"}
    kind = kinds.get(str(one.get("type")), "list" if one.get("type") == "array" else "section of keys")
    if one.get("type") == "array" and "prefixItems" in one:
        kind = f"list of {len(one['prefixItems'])} numbers"
    limits = [text.format(f"{one[key]:.12g}") for key, text in _LIMITS.items() if key in one]
    return ", ".join([kind, *limits])


# A site file written for people: every section and key with what it means, from the models' own descriptions.

INLINE = ("targets", "park", "window")
_WIDE = 46


def site_text(tree: Mapping[str, Any], head: str = "", notes: Mapping[str, str] | None = None) -> str:
    """The TOML text of a tree; ``head`` begins it as comment, ``notes`` (by "X1.travel") stand behind a key.

    What is left out has its default and stands in no line.
    """
    lines = [f"# {line}".rstrip() for line in head.splitlines()]
    for name, field in SiteFile.model_fields.items():
        model, value = section_of(field.annotation), tree.get(name)
        if model is not None and value is not None:
            header = f"[[{name}]]" if is_list(field.annotation) else f"[{name}]"
            for one in value if is_list(field.annotation) else [value]:
                lines += _written_section(header, model, one, notes or {})
    return "\n".join(lines) + "\n"


def _written_section(
    header: str, model: type[BaseModel], values: Mapping[str, Any], notes: Mapping[str, str]
) -> Iterator[str]:
    yield from ("", f"# {_meaning_of(model)}", header)
    inner = []
    name = header.strip("[]")
    for key, field in model.model_fields.items():
        if key not in values:
            continue
        below = section_of(field.annotation)
        if key == "settings":
            inner += _settings(f"{name}.settings", str(values.get("driver", "sinumerik-opcua")), values[key])
        elif below is not None and key not in INLINE:
            inner += [line for line in _written_section(f"[{name}.{key}]", below, values[key], notes) if line]
        else:
            note = notes.get(f"{values.get('name', name)}.{key}", "")
            yield _line(key, values[key], "; ".join(filter(None, (field.description, note))))
    yield from inner


def _settings(header: str, driver: str, values: Mapping[str, Any]) -> list[str]:
    specs = {**registry.known(INSTRUMENTS[1]), **registry.known(INSTRUMENTS[0]), **registry.known("controller")}
    model = specs[driver].load_settings() if driver in specs else None
    fields = model.model_fields if model is not None else {}
    told = {key: fields[key].description or "" if key in fields else "" for key in values}
    lines = [_line(key, value, told[key]) for key, value in values.items()]
    return [f"# What only the driver {driver} knows.", f"[{header}]", *lines] if lines else []


def _line(key: str, value: Any, comment: str) -> str:
    text = f"{key} = {toml_value(value)}"
    return f"{text:<{_WIDE}} # {comment}" if comment else text


def _meaning_of(model: type[BaseModel]) -> str:
    first = (model.__doc__ or "").strip().split("\n")[0]
    return first.replace("``", "")


def toml_value(value: Any) -> str:
    """A value in TOML: texts, numbers, true and false, lists and inline tables."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, int | float):
        return repr(value)
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
