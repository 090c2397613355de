"""Alarm texts by OPC UA events, asked for beside the main session so that nothing there can be disturbed."""

from __future__ import annotations

from drivers.errors import TrueflankError
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.requests import AlarmEvent


async def standing(session: UaSession, timeout_s: float) -> tuple[AlarmEvent, ...] | None:
    """All standing alarms as events, by a session of their own that ends with the answer.

    None when they cannot be had (no right, no events, too slow): the alarm variables say then what they can.
    """
    beside: UaSession | None = None
    try:
        beside = await session.beside(timeout_s)
        told = await beside.alarm_events(timeout_s)
    except TrueflankError:
        return None
    finally:
        if beside is not None:
            await beside.close()
    return None if told is None else tuple(alarm for alarm in told if alarm.standing)


def text(alarms: tuple[AlarmEvent, ...] | None) -> str:
    """Their texts, the gravest first; "" when there are none."""
    ordered = sorted(alarms or (), key=lambda alarm: -alarm.severity)
    return "; ".join(f"{alarm.number} {alarm.text}".strip() for alarm in ordered if alarm.text)
