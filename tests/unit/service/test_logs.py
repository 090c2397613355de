"""The service's own log: structured, one line each, with what happened at work, and without what sounds secret."""

from __future__ import annotations

import asyncio
import logging
import sys
from pathlib import Path

import pytest

from gateway.daemon.service_manager import JournalForm, log_into
from gateway.live import of_device, of_run
from gateway.store.log_book import LogBook, lines_of
from tests.unit.audit.log import Moments


def test_what_the_program_says_is_kept_and_hides_what_sounds_secret(tmp_path: Path) -> None:
    with log_into(LogBook(tmp_path, Moments().utc)):
        logging.getLogger("trueflank.mqtt").warning("at mqtt://anna:hunter2@hall: password = hunter3, token='hunter4'")
        logging.getLogger("trueflank.daemon").info("well")
        logging.getLogger("asyncio").info("too quiet")
        logging.getLogger("asyncio").error("a task broke")
    logging.getLogger("trueflank.daemon").warning("after the end")
    found = list(lines_of(tmp_path))
    assert [(one["level"], one["fields"]["source"]) for one in found] == [
        ("WARNING", "mqtt"),
        ("INFO", "daemon"),
        ("ERROR", "asyncio"),
    ]
    assert "hunter" not in (tmp_path / "logs" / "trueflank.log").read_text(encoding="ascii")


@pytest.mark.parametrize(("environment", "begins"), [({"JOURNAL_STREAM": "8:1"}, "<3>ERROR"), ({}, "ERROR")])
def test_the_journal_gets_one_line_with_its_level(environment: dict[str, str], begins: str) -> None:
    try:
        raise ValueError("secret = hunter2\nsecond line")
    except ValueError:
        record = logging.LogRecord("trueflank.x", logging.ERROR, "p", 1, "it broke", None, sys.exc_info())
    line = JournalForm(environment).format(record)
    assert line.startswith(f"{begins} trueflank.x: it broke: ValueError: ")
    assert "\n" not in line
    assert "hunter2" not in line


def test_a_line_names_the_run_and_the_device_that_it_concerns(tmp_path: Path) -> None:
    seen: list[str] = []
    ours, form = logging.getLogger("trueflank.daemon"), JournalForm({})

    async def opened(name: str) -> None:
        of_device(name)
        logging.getLogger("asyncua.client").warning("refused")
        seen.append(form.format(logging.LogRecord("trueflank.x", logging.INFO, "", 0, "opened", (), None)))

    async def both() -> None:
        with of_run(lambda: "20260301T000000000Z-hall-3-0001"):
            await asyncio.gather(opened("controller"), opened("laser"))
            ours.info("of the run alone")

    with log_into(LogBook(tmp_path, Moments().utc)):
        asyncio.run(both())
        ours.info("of nothing")
    run = "20260301T000000000Z-hall-3-0001"
    found = [(line["run"], line["device"]) for line in lines_of(tmp_path)]
    assert found == [(run, "controller"), (run, "laser"), (run, ""), ("", "")]
    assert seen[0] == f"INFO trueflank.x [{run} controller]: opened"
