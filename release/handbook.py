"""What the handbook's builder is told: pages generated from the code, and links out of `docs` as plain names.

A hook of MkDocs. It reads source and data as text and runs none of our code, so the builder needs nothing of ours.
"""

from __future__ import annotations

import ast
import json
import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).absolute().parents[1]
FOREIGN = re.compile(r'<script src="https?://[^"]+"></script>')
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|mailto:)([^)\s]+)\)")


def codes() -> str:
    """Every code with what happened and what to do."""
    told: dict[str, dict[str, str]] = {}
    for file in sorted((ROOT / "drivers" / "messages" / "en").glob("*.toml")):
        told |= tomllib.loads(file.read_text(encoding="utf-8"))
    head = "# Error codes\n\n`trueflank explain CODE` says the same. Words in braces are filled in.\n"
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
    paths: dict[str, dict[str, Any]] = json.loads((ROOT / "docs" / "openapi.json").read_text(encoding="utf-8"))["paths"]
    rows = [
        f"| `{verb.upper()} {path}` | {_cell(str(told.get('summary', '')))} |"
        for path, verbs in sorted(paths.items())
        for verb, told in verbs.items()
    ]
    source = (ROOT / "gateway" / "web" / "metrics.py").read_text(encoding="utf-8")
    named = re.findall(r"\"(trueflank_\w+)\",\s*\"([^\"]+)\"", source)
    metrics = "\n".join(f"| `{name}` | {_cell(text)} |" for name, text in named)
    return (
        "# Service: addresses and metrics\n\n| address | what it does |\n|---|---|\n"
        + "\n".join(rows)
        + f"\n\n## Metrics\n\n| metric | meaning |\n|---|---|\n{metrics}\n"
    )


GENERATED = {"codes.md": codes, "records.md": records, "routes.md": routes}


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made from the code."""
    from mkdocs.structure.files import File  # noqa: PLC0415 - the builder's own

    for name, page in GENERATED.items():
        files.append(File.generated(config, name, content=page()))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn a link to a file of the source beside `docs` into its name; a file that is not there ends the build."""
    here = (ROOT / "docs" / page.file.src_uri).parent
    docs = ROOT / "docs"

    def plain(match: re.Match[str]) -> str:
        text, link = match.groups()
        target = Path(os.path.normpath(here / link.partition("#")[0]))
        if target.is_relative_to(docs):
            if target.is_dir():
                return f"{text} (`{target.relative_to(ROOT)}`)"
            return match.group(0)
        if not target.exists():
            raise FileNotFoundError(f"{page.file.src_uri}: {link} is not there")
        return f"{text} (`{target.relative_to(ROOT)}`)"

    return LINK.sub(plain, markdown)


def on_post_page(output: str, **_: Any) -> str:
    """Take out what a page would load from elsewhere: without a network it is not there."""
    return FOREIGN.sub("", output)


def on_post_template(output_content: str, **_: Any) -> str:
    """The same for the page of what is not found."""
    return FOREIGN.sub("", output_content)
