"""A site file written for people: every section and key with what it means, from the models' own descriptions."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from drivers import registry
from gateway.config.keyfaults import is_list, section_of
from gateway.config.reaching import INSTRUMENTS
from gateway.config.sections import SiteFile

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
                lines += _section(header, model, one, notes or {})
    return "\n".join(lines) + "\n"


def _section(header: str, model: type[BaseModel], values: Mapping[str, Any], notes: Mapping[str, str]) -> Iterator[str]:
    yield from ("", f"# {_first(model)}", header)
    inner = []
    name = header.strip("[]")
    for key, field in model.model_fields.items():
        if key not in values:
            continue
        below = section_of(field.annotation)
        if key == "settings":
            inner += _settings(f"{name}.settings", str(values.get("driver", "sinumerik-opcua")), values[key])
        elif below is not None and key not in INLINE:
            inner += [line for line in _section(f"[{name}.{key}]", below, values[key], notes) if line]
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
    text = f"{key} = {written(value)}"
    return f"{text:<{_WIDE}} # {comment}" if comment else text


def _first(model: type[BaseModel]) -> str:
    first = (model.__doc__ or "").strip().split("\n")[0]
    return first.replace("``", "")


def written(value: Any) -> str:
    """A value in TOML: texts, numbers, true and false, lists and inline tables."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {written(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    if isinstance(value, int | float):
        return repr(value)
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
