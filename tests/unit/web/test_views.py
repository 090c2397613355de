"""Pictures: states in one word, tables as text, data as JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from drivers.errors import TransportError
from drivers.stale_programs import StaleProgram
from drivers.types.machine import ChannelStatus, MachineState
from gateway.config import SiteFile
from gateway.domain.outcomes import AxisVerdict, Verdict
from gateway.views import RunView, as_data, axis_table, control_view, device_views
from gateway.views.measurements import plan_of
from tests.unit.report.synthetic import axis_material
from tests.unit.web.client import Client
from tests.unit.web.pictures import Seen, status
from tests.unit.web.services import TOKEN, offered
from tests.unit.web.test_daemon import SITE


def test_a_closed_device_is_lent_only_while_a_run_has_it() -> None:
    seen = [Seen("laser", "umd", "closed"), Seen("controller", "sinumerik-opcua", "failed")]
    assert [view.state for view in device_views(seen, lent=True)] == ["in use", "failed"]
    assert [view.state for view in device_views(seen, lent=False)] == ["closed", "failed"]


def test_a_device_error_becomes_code_words_and_fields() -> None:
    error = TransportError("E-LINK-DEADLINE", "laser", timeout_s=5)
    (view,) = device_views([Seen("laser", "umd", "lost", error=error)], lent=False)
    assert view.error is not None
    assert view.error["code"] == "E-LINK-DEADLINE"
    assert view.error["fields"] == {"timeout_s": "5"}
    assert "5 s" in str(view.error["what"])


def test_one_word_for_all() -> None:
    ready = replace(status(run=None), devices=device_views([Seen("laser", "umd", "open")], lent=False))
    assert status().state == "running"
    assert status(run=None).state == "attention"
    assert ready.state == "ready"
    assert replace(ready, trouble={"code": "E-SUP-MACHINE"}).state == "attention"


def test_progress_is_known_only_with_a_total() -> None:
    run = RunView("r", "", "X1", 0, 0, "", "")
    assert run.progress is None
    assert replace(run, done=3, total=12).progress == 0.25
    assert replace(run, done=13, total=12).progress == 1.0


def test_table_has_five_lines_an_axis_and_dashes_for_nothing() -> None:
    axis = axis_material("X1", "mm")
    assert axis.before is not None
    assert axis.after is not None
    before, after = replace(axis.before, E=20.0, M=None), replace(axis.after, E=5.0)
    verdict = Verdict((AxisVerdict("X1", "um", before, after, True, True, ()),), "better")
    rows = axis_table(verdict)
    assert [row.parameter for row in rows] == ["E", "R", "B", "A", "M", "M_travel"]
    assert (rows[0].axis, rows[0].before, rows[0].after, rows[0].unit, rows[0].change) == (
        "X1", "20.00", "5.00", "um", "−75 %",
    )  # fmt: skip
    assert (rows[4].before, rows[4].change) == ("–", "–")


def test_data_are_json_with_state_and_progress() -> None:
    data = json.loads(json.dumps(as_data(status()), allow_nan=False))
    assert data["state"] == "running"
    assert data["run"]["progress"] == 0.05
    assert data["devices"][1]["error"]["code"] == "E-LINK-DEADLINE"
    assert data["last_runs"][0] == {
        "run_id": "r-2", "created_utc": "2026-03-01T09:00:00+00:00", "state": "better", "problem": "", "report": True,
    }  # fmt: skip
    assert as_data(status(run=None))["run"] is None


def test_something_of_ours_in_the_control_is_never_ready(tmp_path: Path) -> None:
    left = StaleProgram("stopped", 123456, "TFPUSH_X1", "TRUEFLANK LOADED").said.as_record()
    clean = status(run=None, devices=())
    assert clean.state == "ready"
    assert status(run=None, devices=(), left=(left,)).state == "attention"
    offer = offered(tmp_path, SITE)
    offer.at.shown = lambda: status(run=None, devices=(), left=(left,))
    shown = Client(offer.app, headers={"Authorization": f"Bearer {TOKEN}"}).get("/status").text
    assert "W-LEFT-STOPPED" in shown
    assert "press RESET at the machine, not NC START" in shown
    assert "Needs attention" in shown


def test_the_control_is_shown_as_it_was_seen_last_and_not_at_all_where_it_was_not() -> None:
    seen = MachineState(ChannelStatus.INTERRUPTED, "AUTO", "TRUEFLANK SETUP EXX ON X", (8040,), 2, {})
    shown = as_data(status(control=control_view(seen)))["control"]
    assert shown == {
        "channel": "interrupted",
        "mode": "AUTO",
        "alarms": (8040,),
        "message": "TRUEFLANK SETUP EXX ON X",
    }
    assert as_data(status(control=control_view(None)))["control"] is None


def test_the_chain_of_the_drawings_is_the_site_files_or_the_grinders_or_unknown() -> None:
    def sides(site: SiteFile) -> dict[str, list[str]]:
        return {side: [one["letter"] for one in links] for side, links in plan_of(site)["chain"].items()}

    assert sides(SITE) == {"work": ["X", "C"], "tool": ["Z"]}
    mill = {"work_side": ["Y", "X", "A", "C"], "tool_side": ["Z"]}
    site = SiteFile.model_validate(SITE.model_dump() | {"machine": mill})
    assert sides(site) == {"work": mill["work_side"], "tool": mill["tool_side"]}
    assert plan_of(site)["chain"]["work"][2] == {"letter": "A", "kind": "revolute", "direction": [1.0, 0.0, 0.0]}
    axis = SITE.axes[0].model_dump() | {"name": "Y1", "letter": "Y"}
    other = SiteFile.model_validate(SITE.model_dump() | {"axes": [axis]})
    assert sides(other) == {"work": [], "tool": []}
