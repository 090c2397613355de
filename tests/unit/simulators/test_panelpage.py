"""The machine's panel as a page: what it shows, what its keys do, and that only its own page may press them."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

import httpx
import pytest

from drivers.clock import LoopClock
from drivers.languages import LANGUAGES, texts_of
from simulators.cell import cell_running
from simulators.cell.__main__ import answered
from simulators.cell.backdoor import BackDoor
from simulators.cell.console import panel_url, serve_panel

KEY = {"content-type": "text/plain"}


@pytest.mark.wall_time
async def test_keys_of_the_panel_do_what_the_same_words_do_and_nobody_else_presses_them(tmp_path: Path) -> None:
    async with cell_running("demo", tmp_path, LoopClock(), wires="memory") as cell:
        judge = BackDoor(cell)

        async def does(line: bytes) -> dict[str, Any]:
            return await answered(judge, line)

        panel = await serve_panel(cell, does)
        try:
            async with httpx.AsyncClient(base_url=panel_url(panel), trust_env=False) as person:
                page = await person.get("/")
                assert "NC START" in page.text
                assert "default-src 'self'" in page.headers["content-security-policy"]
                for file in ("/panel.js", "/panel.css"):
                    assert (await person.get(file)).status_code == 200
                now = (await person.get("/machine")).json()
                assert now["auto"] is True
                assert "EXX X" in now["mountings"]
                assert "laser" in now["instruments"]
                for typed in ("auto off", "mount EXX X1", "mount EYX X", "break laser"):
                    assert "error" not in (await person.post("/do", content=typed, headers=KEY)).json(), typed
                assert cell.operator.spec.auto is False
                assert cell.bench.mounted("straightness") is not None
                assert "error" in (await person.post("/do", content="open the door", headers=KEY)).json()
                foreign = await person.post(
                    "/do", content="reset", headers=KEY | {"origin": "http://elsewhere.example"}
                )
                renamed = await person.get("/machine", headers={"host": "elsewhere.example"})
                assert (foreign.status_code, renamed.status_code) == (403, 403)
                assert (await person.get("/../panel.py")).status_code == 404
        finally:
            await panel.close()


def test_the_console_has_every_sentence_in_every_language() -> None:
    folder = resources.files("simulators.cell")
    html, script = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("panel.html", "panel.js"))
    asked = {f"panel.{key}" for key in re.findall(r'data-(?:text|label)="(\w+)"', html)}
    asked |= {
        f"panel.{key}" for key in re.findall(r'\bt\("(\w+)"\)|\["[^"]+", "(\w+)"\]', script) for key in key if key
    }
    assert len(asked) > 25
    assert {language: set(texts_of("panel", language)) for language in LANGUAGES} == dict.fromkeys(LANGUAGES, asked)
    assert not re.search(r">[A-Z][a-z]+ [a-z]", html.partition("<body>")[2]), "no sentence stands in the page itself"
