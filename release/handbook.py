"""What the handbook's builder is told of links: out of `docs` they are plain names, pages go by their titles.

A hook of MkDocs. It runs none of our code, so the builder needs nothing of ours.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).absolute().parents[1]
FOREIGN = re.compile(r'<script src="https?://[^"]+"></script>')
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|mailto:)([^)\s]+)\)")
TITLE = re.compile(r"^# (.+)$", re.MULTILINE)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn a link to a file of the source beside `docs` into its name; a file that is not there ends the build."""
    here = (ROOT / "docs" / page.file.src_uri).parent
    docs = ROOT / "docs"

    def plain(match: re.Match[str]) -> str:
        text, link = match.groups()
        target = Path(os.path.normpath(here / link.partition("#")[0]))
        if target.is_relative_to(docs) and not target.is_dir():
            # Beside the source a page is called by its file; here nobody sees files.
            return f"[{_title(target)}]({link})" if text == target.name and target.exists() else match.group(0)
        if not target.exists():
            raise FileNotFoundError(f"{page.file.src_uri}: {link} is not there")
        name = f"`{target.relative_to(ROOT)}`"
        return name if Path(os.path.normpath(text.strip("`"))).name == target.name else f"{text} ({name})"

    return LINK.sub(plain, markdown)


def _title(page: Path) -> str:
    found = TITLE.search(page.read_text(encoding="utf-8"))
    return found[1] if found else page.name


def on_post_page(output: str, **_: Any) -> str:
    """Take out what a page would load from elsewhere: without a network it is not there."""
    return FOREIGN.sub("", output)


def on_post_template(output_content: str, **_: Any) -> str:
    """The same for the page of what is not found."""
    return FOREIGN.sub("", output_content)
