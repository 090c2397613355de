"""Pages of the handbook that are made from the code: codes, records, the service's addresses and metrics, the library.

A hook of MkDocs. It reads source and data as text and runs none of our code, so the builder needs nothing of ours.
"""

from __future__ import annotations

import ast
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).absolute().parents[1]
METRIC = re.compile(r'(_gauge|Counter\w+|Info\w+)\(\s*"(trueflank\w*)",\s*"([^"]+)",?\s*(?:labels=)?(\(.*?\)|{.*?})')
LABEL = re.compile(r'"(\w+)"')


ROUTES = """# Service: addresses and metrics

For programs that use the service. Send the token of an account as `Authorization: Bearer ...`; bodies
and answers are JSON. [A service for months](service.md) describes accounts and tokens. The machine-readable form is
[openapi.json](openapi.json), served at `/api/v1/openapi.json`.

A command answers 202 with the number of its job. Without `apply` nothing is written. A refusal contains the code of
the error ([error codes](codes.md)); 422 is a body that does not match the description.
"""
METRICS = """
## Metrics

`GET /metrics`, in the text form of Prometheus.

| metric | kind | labels | meaning |
|---|---|---|---|
"""
LIBRARY = """# The library, name by name

`import trueflank as tf`. Lengths and positions in mm, deviations in um, angles of axes in deg, deviations of angles in
arcsec. [The library](library.md) shows how to combine them.

"""
REFUSED = """### `tf.TrueflankError`

Every refusal: `.code` is one of the [error codes](codes.md), the text states what is wrong and what to do.
"""


def codes() -> str:
    """Every code with what happened and what to do."""
    told: dict[str, dict[str, str]] = {}
    for file in sorted((ROOT / "drivers" / "messages" / "en").glob("*.toml")):
        told |= tomllib.loads(file.read_text(encoding="utf-8"))
    head = "# Error codes\n\n`trueflank explain CODE` shows the same. Words in braces are placeholders.\n"
    kinds = (("E-", "Errors"), ("W-", "Verdicts and warnings"), ("P-", "Progress"))
    parts = []
    for start, title in kinds:
        of_it = sorted(code for code in told if code.startswith(start))
        lines = [f"| `{code}` | {_cell(told[code]['what'])} | {_cell(told[code].get('do', ''))} |" for code in of_it]
        parts.append(
            f"\n## {title}\n\n| code | what happened | what to do |\n|---|---|---|\n" + "\n".join(lines) + "\n"
        )
    return head + "".join(parts)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")


def _records(path: Path) -> Iterator[str]:
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        frozen = isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(one) for one in node.decorator_list)
        if not isinstance(node, ast.ClassDef) or not frozen:
            continue
        fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
        rows = [f"| `{ast.unparse(one.target)}` | `{_cell(ast.unparse(one.annotation))}` |" for one in fields]
        yield (
            f"## {node.name}\n\n{ast.get_docstring(node) or ''}\n\n| field | type |\n|---|---|\n"
            + "\n".join(rows)
            + "\n"
        )


def records() -> str:
    """The records that a run folder holds, from their definitions."""
    files = [*sorted((ROOT / "gateway" / "domain").glob("*.py")), ROOT / "gateway" / "tooth.py"]
    found = [one for file in files for one in _records(file)]
    head = "# Records of a run\n\nA run folder holds these as JSON. Units are part of the names.\n\n"
    return head + "\n".join(found)


def routes() -> str:
    """What the service answers, from its description, and its metrics, from their definitions."""
    told: dict[str, Any] = json.loads((ROOT / "docs" / "openapi.json").read_text(encoding="utf-8"))
    parts: dict[str, list[str]] = {}
    for path, verbs in sorted(told["paths"].items()):
        for verb, one in verbs.items():
            about = (one.get("tags") or ["the service itself"])[0]
            parts.setdefault(about, []).append(_route(f"{verb.upper()} {path}", one, told["components"]["schemas"]))
    body = "".join(f"\n## {about.capitalize()}\n\n" + "\n".join(found) for about, found in parts.items())
    return ROUTES + body + _metrics()


def _route(name: str, one: dict[str, Any], schemas: dict[str, Any]) -> str:
    lines = [f"### `{name}`", "", str(one.get("description") or one.get("summary", "")), ""]
    asked = [(it["name"], it["in"], it["schema"], it.get("required")) for it in one.get("parameters", [])]
    for kind, content in one.get("requestBody", {}).get("content", {}).items():
        found = schemas.get(str(content["schema"].get("$ref", "")).rpartition("/")[2], {})
        needed, form = found.get("required", []), kind.rpartition("/")[2]
        asked += [(key, form, given, key in needed) for key, given in found.get("properties", {}).items()]
        if found.get("properties") and found.get("description"):
            lines += [str(found["description"]), ""]
    if asked:
        lines += ["| given | where | type | |", "|---|---|---|---|"]
    for key, where, given, needed in asked:
        lines.append(f"| `{key}` | {where} | {_type(given)} | {'needed' if needed else _usual(given)} |")
    return "\n".join([*lines, ""])


def _type(given: dict[str, Any]) -> str:
    choices = [one for one in given.get("anyOf", []) if one.get("type") != "null"]
    if choices:
        return " or ".join(_type(one) for one in choices)
    if "enum" in given:
        return ", ".join(f"`{one}`" for one in given["enum"])
    if given.get("type") == "array":
        return f"list of {_type(given.get('items', {}))}"
    return str(given.get("type") or str(given.get("$ref", "")).rpartition("/")[2] or "any")


def _usual(given: dict[str, Any]) -> str:
    return f"else `{json.dumps(given['default'])}`" if "default" in given else ""


def _metrics() -> str:
    source = (ROOT / "gateway" / "web" / "metrics.py").read_text(encoding="utf-8")
    rows = []
    for kind, name, words, labels in METRIC.findall(source):
        form = "gauge" if kind == "_gauge" else "counter" if kind.startswith("Counter") else "info"
        shown = {"counter": f"{name}_total", "info": f"{name}_info"}.get(form, name)
        rows.append(
            f"| `{shown}` | {form} | {', '.join(f'`{one}`' for one in LABEL.findall(labels))} | {_cell(words)} |"
        )
    return METRICS + "\n".join(rows) + "\n"


def library() -> str:
    """Every name of the library with what its docstring says."""
    names = {
        str(one.value)
        for node in ast.parse((ROOT / "trueflank" / "__init__.py").read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        for one in ast.walk(node.value)
        if isinstance(one, ast.Constant)
    }
    found: dict[str, str] = {}
    for file in sorted((ROOT / "trueflank").glob("*.py")):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name in names:
                found[node.name] = _entry(node, "tf.")
    found["TrueflankError"] = REFUSED
    laser = ast.parse((ROOT / "trueflank" / "interferometer.py").read_text(encoding="utf-8"))
    functions_of = [one for one in laser.body if isinstance(one, ast.FunctionDef) and one.name[0] != "_"]
    found["interferometer"] = "\n".join(
        [f"### `tf.interferometer`\n\n{_prose(ast.get_docstring(laser) or '')}\n"]
        + [_entry(one, "tf.interferometer.") for one in functions_of]
    )
    found["__version__"] = "### `tf.__version__`\n\nThe version, as `trueflank --version` says it.\n"
    functions = "\n".join(found[name] for name in sorted(found) if name.islower())
    classes = "\n".join(found[name] for name in sorted(found) if not name.islower())
    return f"{LIBRARY}## Functions\n\n{functions}\n## What they take and give\n\n{classes}"


def _entry(node: ast.FunctionDef | ast.ClassDef, before: str) -> str:
    level = "###" if before == "tf." else "####"
    told = _prose(ast.get_docstring(node) or "")
    if isinstance(node, ast.FunctionDef):
        return f"{level} `{before}{node.name}({_signature(node)}){_gives(node)}`\n\n{told}\n"
    parts = [f"{level} `{before}{node.name}`\n\n{told}\n", _fields(node)]
    for one in node.body:
        if isinstance(one, ast.FunctionDef) and one.name == "__init__":
            parts.append(f"#### `tf.{node.name}({_signature(one)})`\n\n{_prose(ast.get_docstring(one) or '')}\n")
        if isinstance(one, ast.FunctionDef) and not one.name.startswith("_"):
            kinds = {ast.unparse(mark) for mark in one.decorator_list}
            made = f"tf.{node.name}." if "classmethod" in kinds else "."
            call = one.name if "property" in kinds else f"{one.name}({_signature(one)})"
            call += _gives(one)
            parts.append(f"#### `{made}{call}`\n\n{_prose(ast.get_docstring(one) or '')}\n")
    return "\n".join(parts)


def _signature(node: ast.FunctionDef) -> str:
    given = ast.unparse(node.args)
    return re.sub(r"^(self|cls)(, )?", "", given)


def _gives(node: ast.FunctionDef) -> str:
    return f" -> {ast.unparse(node.returns)}" if node.returns is not None and node.name != "__init__" else ""


def _fields(node: ast.ClassDef) -> str:
    """A table of a record's fields with their types; units and shapes stand in its docstring."""
    rows = [
        f"| `{ast.unparse(one.target)}` | `{_cell(ast.unparse(one.annotation))}` |"
        for one in node.body
        if isinstance(one, ast.AnnAssign)
    ]
    return "\n".join(("| field | type |", "|---|---|", *rows, "")) if rows else ""


def _prose(text: str) -> str:
    """A docstring as a page has it: names in code, a warning's braces kept."""
    return re.sub(r"``(.+?)``", r"`\1`", text)


GENERATED = {"codes.md": codes, "records.md": records, "routes.md": routes, "library-reference.md": library}


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made from the code."""
    from mkdocs.structure.files import File  # noqa: PLC0415 - the builder's own

    for name, page in GENERATED.items():
        files.append(File.generated(config, name, content=page()))
    return files
