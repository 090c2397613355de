"""What the captures and the site file tell of the shop: drift, clamping, scatter; and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import hypot

from drivers.message import Message, digits, fixed
from gateway.config import WorkSection
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.domain.captures import Capture
from gateway.domain.values import COVERAGE
from gateway.evaluate.behaviour.repeatability import approach_of, instrument_noise
from gateway.gear.grinding import Grinding
from gateway.workflow.axes.measure import MeasuredAxis


def _with_drift(shop: ProcessUncertainty, captures: Mapping[str, Capture], grinding: Grinding) -> ProcessUncertainty:
    """Drift measured is drift believed: the larger of what the site file says and what the captures saw."""
    seen = {letter: abs(capture.drift_per_h) for letter, capture in captures.items()}
    return replace(
        shop,
        drift_um_per_h=max(shop.drift_um_per_h, seen.get(grinding.infeed, 0.0)),
        drift_arcsec_per_h=max(shop.drift_arcsec_per_h, seen.get(grinding.index, 0.0)),
    )


def drifting(shop: ProcessUncertainty, work: WorkSection | None) -> tuple[Message, ...]:
    """Where a drift was seen that is larger than the site file's, in words."""
    said = _said_of(work)
    pairs = (
        ("infeed", shop.drift_um_per_h, said.drift_um_per_h, "um"),
        ("index", shop.drift_arcsec_per_h, said.drift_arcsec_per_h, "arcsec"),
    )
    return tuple(
        Message.of("S-TOOTH-DRIFT", what=what, seen=fixed(seen, 1), said=digits(told, 6), unit=unit)
        for what, seen, told, unit in pairs
        if seen > told
    )


def noisy(measured: Mapping[str, MeasuredAxis]) -> tuple[Message, ...]:
    """Where the instrument at rest scatters more than its readings' own windows show, in words."""
    captures = {name: item.capture for name, item in measured.items() if item.capture.rest_count}
    return tuple(
        Message.of(
            "S-TOOTH-NOISE",
            axis=name,
            noise=digits(one.rest_u),
            axis_own=digits(approach_of(one).scatter),
            unit=one.unit,
        )
        for name, one in captures.items()
        if instrument_noise(one) > one.reading_u
    )


def _said_of(work: WorkSection | None) -> ProcessUncertainty:
    """What the site file says of clamping, drift and times; the usual where it says nothing."""
    if work is None:
        return ProcessUncertainty()
    keys = ("clamping_um", "drift_um_per_h", "drift_arcsec_per_h", "part_h")
    return replace(
        ProcessUncertainty(), **{key: getattr(work, key) for key in keys}, size_um=work.inspection_size_um / COVERAGE
    )


def shop_of(work: WorkSection | None, captures: Mapping[str, Capture], grinding: Grinding) -> ProcessUncertainty:
    """What site file and captures (by axis letter) say of clamping, drift and scatter; the usual for the rest."""
    shop = _with_drift(_said_of(work), captures, grinding)
    known = {letter: approach_of(capture) for letter, capture in captures.items()}
    if grinding.infeed in known:
        shop = replace(shop, infeed_um=known[grinding.infeed].scatter)
    if grinding.index in known:
        turned = known[grinding.index]
        shop = replace(shop, index_arcsec=hypot(turned.scatter, turned.reversal))
    return shop
