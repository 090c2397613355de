"""The picture of the command at work: what is asked for stands beside what will move then."""

from __future__ import annotations

import asyncio
from typing import Any

from gateway.daemon.job_runner import Job
from gateway.daemon.stream import MOST_MOVES, new_run_view, updated_run
from gateway.stopping import StopAsked
from gateway.views import JobView, RunView

X_GOES = ("P-MOVE-TO", {"axis": "X", "start": "0", "end": "100", "unit": "mm", "feed": "500"})
REST = ("P-MOVE-OTHERS", {"others": "Z1 at 0 mm"})
PRESS = ("P-START", {"axis": "X", "program": "TFMEASX"})


def _seen(*said: tuple[str, dict[str, Any]]) -> RunView:
    run = new_run_view(
        JobView(job=1, kind="run", who="anna", state="running", run_id="", started_utc="", ended_utc="", words="")
    )
    for code, fields in said:
        run = updated_run(run, code, fields)
    return run


def _moves(run: RunView) -> list[object]:
    return [one["code"] for one in run.moves]


def test_every_motion_before_a_press_stands_beside_it_for_a_page_that_comes_later() -> None:
    run = _seen(X_GOES, REST, PRESS)
    assert run.ask is not None
    assert _moves(run) == ["P-MOVE-TO", "P-MOVE-OTHERS"]
    assert run.moves[0]["words"] == "X will go from 0 to 100 mm at 500 mm/min"


def test_what_moves_at_the_next_press_is_not_what_moved_at_this_one() -> None:
    assert _moves(_seen(X_GOES, REST, PRESS, X_GOES)) == ["P-MOVE-TO"]
    assert _moves(_seen(X_GOES, PRESS, ("P-PUSH-STEP", {"axis": "X1", "step": "BACKUP"}))) == ["P-MOVE-TO"]
    stop = {"axis": "X1", "program": "TFMEASX", "done": 1, "total": 5}
    run = _seen(X_GOES, PRESS, ("P-STOP", stop))
    assert (run.ask, run.moves) == (None, ())
    assert len(_seen(*[X_GOES] * (MOST_MOVES + 5)).moves) == MOST_MOVES


def test_a_page_that_comes_later_knows_what_is_true_of_each_table() -> None:
    async def nothing(_say: object) -> None:
        """No work."""

    async def heard() -> tuple[tuple[str, str], ...]:
        view = JobView(job=1, kind="push", who="anna", state="running", run_id="", started_utc="")
        job = Job(nothing, view, StopAsked())
        for axis, state in (("X1", "begun"), ("C1", "begun"), ("X1", "writing"), ("X1", "written")):
            job.heard("P-TABLE-STATE", {"axis": axis, "state": state, "said": ""})
        return job.view.tables

    assert asyncio.run(heard()) == (("X1", "written"), ("C1", "begun"))
