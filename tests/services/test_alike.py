"""The same commands with and without the service: the same words and exit codes; run by `make services`."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from gateway.config import load_site
from gateway.workflow.run.folder import store_of
from tests.browser.hall import hall
from tests.cell.bench import short

pytestmark = [pytest.mark.services, pytest.mark.timeout(900)]
LOOKS = (
    ("doctor",),
    ("doctor", "--json"),
    ("recover",),
    ("disable", "--axis", "C1"),
    ("rollback", "--axis", "C1"),
    ("tables", "verify"),
    ("doctor", "certificate"),
    ("doctor", "devices"),
    ("push",),
)
WORKS = (("doctor", "self-test"), ("run",), ("run", "--apply", "--machine", "another"))
# What is another one each time: runs, moments, hashes, ports, process numbers.
EACH = (
    (re.compile(r"\b\d{8}T\d{9}Z-[\w-]+"), "RUN"),
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(\+00:00| UTC)?"), "MOMENT"),
    (re.compile(r"\b[0-9a-f]{12,}\b"), "HASH"),
    (re.compile(r"differs from this PC's clock by \S+ s"), "CLOCK"),
)
NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def typed(site: Path, words: Sequence[str]) -> list[str]:
    """The command as a person types it; of a push a run is named, not a site."""
    if words[0] == "push":
        return [*words, "latest", "--store", str(store_of(load_site(site), site).root)]
    before = 2 if len(words) > 1 and not words[1].startswith("-") else 1
    return [*words[:before], str(site), *words[before:]]


def said(site: Path, words: Sequence[str], *, measures: bool) -> tuple[int, list[str]]:
    """Exit code and every line of a command, without what is another one each time; ``measures``: and no figures."""
    done = subprocess.run(
        [sys.executable, "-m", "gateway.cli", *typed(site, words)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    text = f"{done.stdout}\n--\n{done.stderr}"
    for pattern, name in EACH:
        text = pattern.sub(name, text)
    if words == ("doctor", "self-test"):  # its next step is the push that waits by then: none does in the first round
        text = re.sub(r"^next: .*$", "next:", text, flags=re.MULTILINE)
    return done.returncode, (NUMBER.sub("N", text) if measures else text).splitlines()


def test_a_command_says_the_same_with_the_service_as_without_it(tmp_path: Path) -> None:
    with hall(tmp_path, short(("C1",), 7, 3), speed=150.0, served=False) as at:
        # The works first: their self-test stays with control and store, where both rounds of looks find it.
        alone = {words: said(at.path, words, measures=words in WORKS) for words in (*WORKS, *LOOKS)}
        at.serve()
        served = {words: said(at.path, words, measures=words in WORKS) for words in (*LOOKS, *WORKS)}
    for words, told in alone.items():
        assert served[words] == told, words
    assert [alone[words][0] for words in WORKS[:2]] == [0, 0]
