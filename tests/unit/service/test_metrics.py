"""Figures for Prometheus, and that the dashboard and the alerts ask for none that is not there."""

from __future__ import annotations

import json
import re
from pathlib import Path

from prometheus_client.parser import text_string_to_metric_families

from drivers.message import Message
from gateway.views import HeldView
from tests.unit.web.client import Client
from tests.unit.web.pictures import status
from tests.unit.web.services import offered
from tests.unit.web.test_daemon import SITE

EXAMPLES = Path(__file__).parents[3] / "examples" / "monitoring"
NAME = re.compile(r"\btrueflank_[a-z_]+")


def figures(folder: Path) -> dict[str, list[tuple[dict[str, str], float]]]:
    """Every sample by its name, as a program with a viewer's token reads them."""
    offer = offered(folder, SITE)
    held = (HeldView("R-HELD-ON: x", loud=True), HeldView("R-HELD-OFF: y", loud=False))
    offer.at.shown = lambda: status(alarms=(Message.stored("X1 differs"),), held=held, due=Message.stored("C1 is due"))
    offer.service.doors.accounts.put("prometheus", ("viewer",), password="a long sentence")
    token, _made = offer.service.doors.accounts.give_token("prometheus", offer.service.clock.utc())
    answer = Client(offer.app).get("/metrics", headers={"Authorization": f"Bearer {token}"})
    assert answer.status_code == 200
    found: dict[str, list[tuple[dict[str, str], float]]] = {}
    for family in text_string_to_metric_families(answer.text):
        for sample in family.samples:
            found.setdefault(sample.name, []).append((dict(sample.labels), sample.value))
    return found


def test_figures_are_those_of_the_page(tmp_path: Path) -> None:
    found = figures(tmp_path)
    assert found["trueflank_alarms"] == [({"site": "hall-3"}, 1.0)]
    devices = {one["device"]: value for one, value in found["trueflank_device_open"]}
    assert devices == {"controller": 1, "laser": 0}
    assert {one["loud"]: value for one, value in found["trueflank_pushes_held"]} == {"true": 1.0, "false": 1.0}
    assert found["trueflank_command_progress_ratio"] == [({"site": "hall-3", "kind": "run"}, 0.05)]
    assert found["trueflank_stream_frames_dropped_total"] == [({"site": "hall-3"}, 7.0)]
    assert found["trueflank_mqtt_messages_dropped_total"] == [({"site": "hall-3"}, 2.0)]
    assert found["trueflank_mqtt_messages_queued"] == [({"site": "hall-3"}, 3.0)]
    assert [one["state"] for one, value in found["trueflank_site_state"] if value] == ["running"]


def test_dashboard_and_alerts_ask_only_for_figures_that_are_there(tmp_path: Path) -> None:
    given = set(figures(tmp_path))
    board = json.loads((EXAMPLES / "grafana.json").read_text(encoding="utf-8"))
    asked = {name for panel in board["panels"] for target in panel["targets"] for name in NAME.findall(target["expr"])}
    alerts = (EXAMPLES / "alerts.yml").read_text(encoding="utf-8")
    warned = {name for line in alerts.splitlines() if "expr:" in line for name in NAME.findall(line)}
    assert asked == given, "each figure has its panel, and each panel its figure"
    assert warned <= given
    assert len({panel["id"] for panel in board["panels"]}) == len(board["panels"])
