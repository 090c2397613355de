"""Figures of the service for Prometheus: made of the same picture as the page, at the moment they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fastapi import APIRouter, Depends, Request
from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from starlette.responses import Response

from gateway.views import StatusView
from gateway.web.doors import needs, service_of
from gateway.web.ports import ServedSite, Service

routes = APIRouter(tags=["reading"], dependencies=[Depends(needs("viewer"))])
STATES = ("ready", "running", "attention", "still-on")


@routes.get("/metrics", response_class=Response)
def metrics(request: Request) -> Response:
    """Figures in the text form of Prometheus; a program asks with the token of an account that may look."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Figures(service_of(request)))
    return Response(generate_latest(registry), headers={"content-type": CONTENT_TYPE_LATEST})


class _Figures:
    """One asking of all sites."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        """Every figure; names and labels are part of what is shipped, see the dashboard."""
        yield InfoMetricFamily("trueflank", "The software", {"software": self._service.software})
        pictures = {name: (one, one.picture()) for name, one in self._service.sites.items()}
        yield _states(pictures)
        yield _devices(pictures)
        yield from _outgoing(pictures)
        alarms = _gauge("trueflank_alarms", "Live tables that are not as they were pushed", ("site",))
        held = _gauge("trueflank_pushes_held", "Pushes that did not end; loud: nothing proves it off", ("site", "loud"))
        left = _gauge("trueflank_left_in_control", "1 while an earlier gateway's program or words stand", ("site",))
        due = _gauge("trueflank_comparison_due", "1 while a person must compare the live tables", ("site",))
        work = _gauge("trueflank_command_progress_ratio", "Part of the command at work that is done", ("site", "kind"))
        heard = _gauge("trueflank_stream_listeners", "Pages that listen", ("site",))
        dropped = CounterMetricFamily("trueflank_stream_frames_dropped", "Frames slow pages lost", labels=("site",))
        for name, (one, seen) in pictures.items():
            alarms.add_metric((name,), len(seen.alarms))
            for loud in (True, False):
                count = sum(push.loud is loud for push in seen.held)
                held.add_metric((name, str(loud).lower()), count)
            left.add_metric((name,), float(bool(seen.left)))
            due.add_metric((name,), float(bool(seen.due)))
            if seen.run is not None:
                work.add_metric((name, seen.run.kind), seen.run.progress or 0.0)
            listening, lost = one.stream_counts()
            heard.add_metric((name,), listening)
            dropped.add_metric((name,), lost)
        refused = CounterMetricFamily("trueflank_sign_ins_refused", "Refused sign-ins since the start", labels=())
        refused.add_metric((), self._service.doors.refused.total)
        yield from (alarms, held, left, due, work, heard, dropped, refused)


_Pictures = Mapping[str, tuple[ServedSite, StatusView]]


def _gauge(name: str, words: str, labels: tuple[str, ...]) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, words, labels=labels)


def _states(pictures: _Pictures) -> GaugeMetricFamily:
    found = _gauge("trueflank_site_state", "1 for the state that a site is in", ("site", "state"))
    for name, (_one, seen) in pictures.items():
        for state in STATES:
            found.add_metric((name, state), float(seen.state == state))
    return found


def _outgoing(pictures: _Pictures) -> Iterator[Metric]:
    there = _gauge("trueflank_mqtt_connected", "1 while the server of messages answers", ("site",))
    queued = _gauge("trueflank_mqtt_messages_queued", "Messages that wait on the disk", ("site",))
    dropped = CounterMetricFamily("trueflank_mqtt_messages_dropped", "Messages ever dropped", labels=("site",))
    for name, (one, _seen) in pictures.items():
        found = one.outgoing()
        if found is not None:
            there.add_metric((name,), float(found.connected))
            queued.add_metric((name,), found.queued)
            dropped.add_metric((name,), found.dropped)
    yield from (there, queued, dropped)


def _devices(pictures: _Pictures) -> GaugeMetricFamily:
    found = _gauge("trueflank_device_open", "1 while a device is open here or lent", ("site", "device", "driver"))
    for name, (_one, seen) in pictures.items():
        for device in seen.devices:
            found.add_metric((name, device.name, device.driver), float(device.state in ("open", "lent")))
    return found
