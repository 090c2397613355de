"""A study in rows for people and in plain data for programs; um and arcsec."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drivers.errors import words
from drivers.message import fixed
from drivers.types.tables import CompensationTable
from drivers.units import DeviationUnit, mm_to_um, rad_to_arcsec
from gateway.correct.flank.compensability import Cure
from gateway.correct.plan.layers import LayeredCorrection
from gateway.gear.flank import FlankFigure
from gateway.gear.grinding import Grinding
from gateway.sensitivity.outputs import OUTPUTS
from gateway.sensitivity.screening import RankedInput
from gateway.study.calculate import State, Study
from gateway.study.drive import drive_data

Row = tuple[str, ...]
PART = 0.5  # of the RMS: a cure that leaves more is none


def tag(study: Study, name: str) -> str:
    """What `cured_by` names, as a kind: none, axis (its table over itself), set-up, cross, product, mech."""
    by = cured_by(study.cures[name])
    if by == "none needed":
        return "none"
    if by.removesuffix(" in part") in {f"{one.name}({one.name})" for one in study.grinding.chain.axes}:
        return "axis"
    if by == "mechanical only":
        return "mech"
    if "zero" in by or "dressing" in by or by.startswith(("mounting", "set-up")):
        return "set-up"
    return "product" if "*" in by else "cross"


def cured_by(cure: Cure) -> str:
    """The simplest cure; where none does it all, the simplest that takes more than half, "in part"."""
    if cure.by != "mechanical only":
        return cure.by
    helping = (family for family, left in cure.left.items() if left <= PART * cure.rms)
    return next((f"{family} in part" for family in helping), cure.by)


def axis_rows(study: Study) -> list[Row]:
    """Range of each axis' own deviation: as it is, with axis tables, predicted with everything."""
    rows = []
    for curve in study.correction.axes:
        values = (float(np.ptp(one)) for one in (curve.before, curve.own_layer, curve.predicted))
        rows.append((curve.axis, *(f"{value:.2f}" for value in values), curve.unit))
    return rows


def tooth_values(state: State) -> dict[str, float]:
    """The tooth's values of one state, um."""
    chart = state.chart
    found = {
        "RMS normal deviation": state.figure.rms,
        "largest normal deviation": state.figure.largest,
        "profile F_a": float(np.max(chart.profile.F)),
        "profile slope f_Ha": float(np.max(np.abs(chart.profile.f_H))),
        "profile form f_fa": float(np.max(chart.profile.f_f)),
        "lead F_b": float(np.max(chart.lead.F)),
        "lead slope f_Hb": float(np.max(np.abs(chart.lead.f_H))),
        "single pitch f_p": max(one.f_p for one in chart.pitch),
        "cumulative pitch F_p": max(one.F_p for one in chart.pitch),
        "runout F_r": chart.runout.F_r,
    }
    return {key: mm_to_um(value) for key, value in found.items()}


def tooth_rows(study: Study) -> list[Row]:
    """Each tooth value as it is, with axis tables alone, with everything."""
    states = [tooth_values(state) for state in (study.before, study.with_own, study.after)]
    return [(key, *(f"{state[key]:.3f}" for state in states), "um") for key in states[0]]


def error_rows(study: Study) -> Sequence[Row]:
    """Every error: alone at the paper's size, its rank, and in this machine what cures it and what is left.

    All sizes have one rotation of the gear taken out, as the flank figure has.
    """
    rank = {one.name: one for one in study.equal.rankings["rms"]}
    rows = []
    for one in study.alone:
        cure, ranked = study.cures[one.name], rank[one.name]
        alone = f"{mm_to_um(one.figure.rms):.3f}", f"{mm_to_um(one.figure.largest):.3f}"
        place = f"{ranked.rank_low}-{ranked.rank_high}" if ranked.rank_low != ranked.rank_high else str(ranked.rank)
        rows.append((one.name, *alone, place, cured_by(cure), _um(cure.rms), _um(cure.floor)))
    return rows


def setup_rows(study: Study) -> list[tuple[str, float, DeviationUnit]]:
    """Each set-up value by name, and how to move the work where it sits wrong, with units."""
    return setup_values(study.correction, study.grinding)


def setup_values(correction: LayeredCorrection, grinding: Grinding) -> list[tuple[str, float, DeviationUnit]]:
    """Each set-up value of a correction by name, with units."""
    found, moved = correction.setup, correction.moved
    (x, y), (a, b) = moved.eccentricity_um, moved.tilt_arcsec
    work: list[tuple[str, float, DeviationUnit]] = [
        ("work eccentricity x", x, "um"),
        ("work eccentricity y", y, "um"),
        ("work tilt a", a, "arcsec"),
        ("work tilt b", b, "arcsec"),
    ]
    return [
        (f"{grinding.infeed} zero", found.x_um, "um"),
        (f"{grinding.index} zero", found.c_arcsec, "arcsec"),
        ("dressing offset", found.dressing_um, "um"),
        *(row for row in work if row[1] != 0.0),
    ]


def floor_lines(study: Study) -> list[str]:
    """What is left step by step, and how a tangential error is met."""
    f = study.floor
    steps = {"before": f.before, "setup": f.setup, "tables": f.tables, "products": f.products}
    tangential = {"alpha": f"{f.alpha_arcsec_per_um:.3f}", "eta": f"{f.eta:.3f}"}
    return [
        words("S-STUDY-FLOOR", **{key: f"{mm_to_um(value):.3f}" for key, value in steps.items()}),
        words("S-STUDY-TANGENTIAL", **tangential),
    ]


def visible_lines(study: Study) -> list[str]:
    """Which combinations of constant errors a gear shows, and what it never shows."""
    seen = study.visible
    combinations = "; ".join(one.words for one in seen.combinations)
    return [
        words("S-STUDY-VISIBLE", rank=seen.rank, count=len(study.names), combinations=combinations),
        words("S-STUDY-INVISIBLE", names=", ".join(seen.invisible) or "-"),
    ]


def product_lines(study: Study) -> list[str]:
    """What product tables would still bring, if their multiplication is proved; else that it is not."""
    if not study.errors.multiplication_proved:
        return [words("S-STUDY-UNPROVED")]
    lines = [
        words("S-STUDY-PRODUCT", name=one.product.name, before=_um(one.before), after=_um(one.after))
        for one in study.products
    ]
    acting = study.with_products
    return lines if acting is None else [*lines, words("S-STUDY-WITH-PRODUCTS", rms=_um(acting.figure.rms))]


def next_line(study: Study) -> str:
    """The error to measure next."""
    best = study.next[0]
    return words(
        "S-STUDY-NEXT", name=best.name, change=fixed(mm_to_um(best.change), 3), share=fixed(100.0 * best.share, 0)
    )


def order_line(study: Study) -> str:
    """How far the first order may be trusted on this machine, and how before and after were calculated."""
    code = "S-STUDY-EXACT" if study.order == "exact" else "S-STUDY-ORDER"
    return words(code, truncation=f"{mm_to_um(study.truncation):.3f}")


def as_data(study: Study) -> dict[str, Any]:
    """Everything as plain data."""
    correction = study.correction
    return {
        "gear": study.gear.name,
        "errors": study.errors.name,
        "points": list(study.grid.shape),
        "truncation_um": mm_to_um(study.truncation),
        "one_at_a_time": {one.name: _alone(study, i) for i, one in enumerate(study.alone)},
        "ranking": {
            kind: {name: [ranking_row(one) for one in screening.rankings[name]] for name in OUTPUTS}
            for kind, screening in (("equal_steps", study.equal), ("measured_spans", study.measured))
        },
        "cures": {name: _cure(study, cure) for name, cure in study.cures.items()},
        "floor": _floor(study),
        "visible": {
            "rank": study.visible.rank,
            "combinations": [one.words for one in study.visible.combinations],
            "invisible": list(study.visible.invisible),
        },
        "by_axis": [_axis(curve) for curve in correction.axes],
        "by_tooth": {name: tooth_values(state) for name, state in _states(study)},
        "flank": _figures(correction),
        "tables": [table_data(one) for one in (*correction.own, *correction.cross)],
        "setup": {name: round(value, 6) for name, value, _ in setup_rows(study)},
        "products": [
            {"name": one.product.name, "before_um": mm_to_um(one.before), "after_um": mm_to_um(one.after)}
            for one in study.products
        ],
        "findings": list(map(str, correction.said)),
        **({} if study.drive is None else {"drive": drive_data(study.drive)}),
        "next": [
            {"name": one.name, "change_um": mm_to_um(one.change), "beyond_um": mm_to_um(one.beyond), "share": one.share}
            for one in study.next
        ],
    }


def _states(study: Study) -> list[tuple[str, State]]:
    states = [("before", study.before), ("with_own", study.with_own), ("after", study.after)]
    return states if study.with_products is None else [*states, ("with_products", study.with_products)]


def _um(value: float) -> str:
    return f"{mm_to_um(value):.3f}"


def _alone(study: Study, i: int) -> dict[str, float]:
    one = study.alone[i]
    return {
        "rms_um": mm_to_um(one.figure.rms),
        "largest_um": mm_to_um(one.figure.largest),
        "first_order_misses_um": mm_to_um(one.missed),
    }


def ranking_row(one: RankedInput) -> dict[str, Any]:
    """One row of a ranking, um."""
    return {
        "name": one.name,
        "rank": one.rank,
        "rank_interval": [one.rank_low, one.rank_high],
        "mu_um": mm_to_um(one.mu),
        "mu_star_um": mm_to_um(one.mu_star),
        "mu_star_interval_um": [mm_to_um(one.low), mm_to_um(one.high)],
        "sigma_um": mm_to_um(one.sigma),
        "mu_share": one.mu_share,
        "sigma_share": one.sigma_share,
        "tied_with": list(one.tied_with),
    }


def _cure(study: Study, cure: Cure) -> dict[str, object]:
    return {
        "by": cured_by(cure),
        "tag": tag(study, cure.error),
        "rms_um": mm_to_um(cure.rms),
        "left_um": mm_to_um(cure.floor),
        "left_by_family_um": {family: mm_to_um(value) for family, value in cure.left.items()},
    }


def _floor(study: Study) -> dict[str, float]:
    f = study.floor
    steps = {"before": f.before, "set_up_values": f.setup, "tables": f.tables, "products": f.products}
    found = {f"{key}_um": mm_to_um(value) for key, value in steps.items()}
    return {**found, "alpha_arcsec_per_um": f.alpha_arcsec_per_um, "eta": f.eta}


def _axis(curve: Any) -> dict[str, object]:
    return {
        "axis": curve.axis,
        "unit": curve.unit,
        "at": curve.at.tolist(),
        "before": curve.before.tolist(),
        "with_own": curve.own_layer.tolist(),
        "predicted": curve.predicted.tolist(),
    }


def _figures(correction: LayeredCorrection) -> dict[str, dict[str, float]]:
    return {
        name: _figure(figure)
        for name, figure in (
            ("before", correction.before),
            ("with_own", correction.with_own),
            ("best_before_rounding", correction.best),
            ("after", correction.after),
            ("after_second_order", correction.checked),
        )
    }


def _figure(figure: FlankFigure) -> dict[str, float]:
    return {
        "rms_um": mm_to_um(figure.rms),
        "largest_um": mm_to_um(figure.largest),
        "rotation_arcsec": rad_to_arcsec(figure.rotation),
    }


def table_data(table: CompensationTable) -> dict[str, object]:
    keys: Sequence[str] = ("kind", "index", "minimum", "maximum", "step", "modulo", "input_unit", "deviation_unit")
    return {"name": table.name, **{key: getattr(table, key) for key in keys}, "deviations": list(table.deviations)}
