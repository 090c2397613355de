"""The tooth before and after with the uncertainty of the change, its figures, and what cannot be corrected."""

from __future__ import annotations

from gateway.domain.grinding_process import CorrectionOrder
from gateway.domain.values import COVERAGE
from gateway.report.document.content import Block, Heading, Pair, Paragraph, PictureBlock, TableBlock, Whole
from gateway.report.document.words import Tongue
from gateway.report.drawings import tooth as drawings
from gateway.report.material import ReportMaterial, ToothMaterial
from gateway.report.sentences import number, signed
from gateway.report.tooth.rows import cure_rows, figure_rows, inspected_parts, setup_rows

PICTURE_MM = 150.0
LEAST_UM = 0.05  # below, what is left of an error is no news


def tooth(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """Everything the main part says of the tooth; nothing for a run without one."""
    material = report.tooth
    if material is None or material.kind == "errors":
        return ()
    found: list[Block] = [Heading(t("tooth"))]
    picture = drawings.before_after(material)
    if picture:
        found.append(PictureBlock(picture, PICTURE_MM, t("tooth_picture")))
    change, figures = _change(material, t), _figures(material, t)
    found += [Pair(change, figures, 0.48)] if change and figures else [*change, *figures]
    found += _setup(material, t)
    return tuple(found) if len(found) > 1 else ()


def _change(material: ToothMaterial, t: Tongue) -> tuple[Block, ...]:
    """Before, after and the change, each with its U: three lines, and the one prediction beneath."""
    rows = _states(material, t)
    if not rows:
        return ()
    verdict = material.verdict
    found: list[Block] = [
        Heading(t("flank_rms"), 2),
        TableBlock((t("state"), t("value"), "U", t("unit")), rows, "lrrl", wide=(0,)),
    ]
    if verdict is not None:
        found.append(Paragraph(t("within_prediction" if verdict.within_prediction else "outside_prediction")))
    if material.part("before").flank is not None:
        found.append(Paragraph(t("set_right_said"), "small"))
    return tuple(found)


def _states(material: ToothMaterial, t: Tongue) -> tuple[tuple[str, ...], ...]:
    rows: list[tuple[str, ...]] = []
    verdict, proposal = material.verdict, material.proposal
    before, after = material.part("before").flank, material.part("after").flank
    u_before = "" if before is None else number(COVERAGE * before.rms_u_um)
    if verdict is not None:
        anew = verdict.before_anew_um
        rows.append((t("rms_ground"), number(verdict.before_um), u_before, "µm"))
        start = verdict.before_set_right_um if anew is None else anew
        rows.append((t("rms_set_right"), number(start), u_before, "µm"))
    elif before is not None:
        rows.append((t("rms_ground"), number(before.fitted.rms_um), u_before, "µm"))
    elif proposal is not None:
        rows.append((t("rms_model"), number(proposal.prediction.before.rms_um), "", "µm"))
    if proposal is not None:
        told = proposal.prediction
        rows.append((t("rms_predicted"), number(told.rms_um), number(COVERAGE * told.rms_u_um), "µm"))
    if after is not None:
        rows.append((t("rms_after"), number(after.fitted.rms_um), number(COVERAGE * after.rms_u_um), "µm"))
    if verdict is not None and verdict.change_um is not None:
        rows.append((t("rms_change"), signed(verdict.change_um), number(verdict.change_U_um), "µm"))
    return tuple(rows)


def _figures(material: ToothMaterial, t: Tongue) -> tuple[Block, ...]:
    rows = figure_rows(material)
    parts = inspected_parts(material)
    if not rows:
        return ()
    head = (t("figure"), *(t.known(f"part_{one.part}", one.part) for one in parts), t("unit"))
    told = tuple((t.known(f"gear_{row.name}", row.name), *(number(one) for one in row.values), "µm") for row in rows)
    return (
        Whole(
            (Heading(t("gear_figures"), 2), TableBlock(head, told, "l" + "r" * len(parts) + "l", dense=True, wide=(0,)))
        ),
    )


def _setup(material: ToothMaterial, t: Tongue) -> tuple[Block, ...]:
    rows = setup_rows(material)
    if not rows:
        return ()
    last = rows[-1]
    values = signed(last.values.x_um), signed(last.values.c_arcsec), signed(last.values.dressing_um)
    return (Paragraph(t("setup_said", x=values[0], c=values[1], dressing=values[2])),)


def wheel(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """What of a part is wheel, dresser, set-up, axes; what each correction gives; what the dressing did."""
    material = None if report.tooth is None else report.tooth.wheel
    if material is None:
        return ()
    found = material.separation
    shares = tuple(
        (t.known(f"share_{one.name}", one.name), number(one.rms_um), number(one.u_um), "µm") for one in found.shares
    )
    blocks: list[Block] = [
        Heading(t("wheel")),
        Paragraph(t("wheel_said", part=", ".join(found.parts), rms=number(found.total_um))),
        TableBlock((t("cause"), "RMS", "u", t("unit")), shares, "lrrl", dense=True, wide=(0,)),
    ]
    if material.order is not None:
        blocks += [Heading(t("corrections"), 2), _corrections(material.order, t)]
        floor, with_form = material.order.floor_um, material.order.undressed_floor_um
        blocks.append(Paragraph(t("wheel_floor", floor=number(floor), with_form=number(with_form)), "small"))
    if material.verdict is not None:
        seen = material.verdict
        told = {"before": number(seen.before_um), "after": number(seen.after_um), "u": number(seen.u_um)}
        blocks.append(Paragraph(t("wheel_held" if seen.held else "wheel_missed", **told)))
    return tuple(blocks)


def _corrections(order: CorrectionOrder, t: Tongue) -> TableBlock:
    drive = any(one.transmission_arcsec is not None for one in order.steps)
    rows: list[tuple[str, ...]] = []
    for one in order.steps:
        row: tuple[str, ...] = (t.known(f"correction_{one.name}", one.name), number(one.flank_um), number(one.u_um))
        if drive:
            error, u = one.transmission_arcsec, one.transmission_u_arcsec
            row = (*row, "" if error is None else number(error, 1), "" if u is None else number(u, 1))
        rows.append(row)
    head = (t("state"), "RMS [µm]", "u [µm]", *((t("transmission_error"), "u [arcsec]") if drive else ()))
    return TableBlock(head, tuple(rows), "l" + "r" * (len(head) - 1), dense=True, wide=(0,))


def incurable(report: ReportMaterial, t: Tongue) -> tuple[Block, ...]:
    """What no table and no set-up value takes, the largest first, with what remains on the flank."""
    if report.tooth is None:
        return ()
    left = [one for one in cure_rows(report.tooth) if one.why and one.floor_um >= LEAST_UM]
    if report.tooth.proposal is None:
        return ()
    heading = Heading(t("incurable"))
    if not left:
        return heading, Paragraph(t("nothing_incurable", limit=number(LEAST_UM)))
    rows = tuple(
        (one.error, t.known(f"error_{one.error}", ""), number(one.rms_um), number(one.floor_um))
        for one in sorted(left, key=lambda one: -one.floor_um)
    )
    head = (t("error"), t("meaning"), t("alone"), t("remains"))
    return (
        heading,
        Paragraph(t("incurable_said", limit=number(LEAST_UM))),
        TableBlock(head, rows, "llrr", dense=True, wide=(1,)),
    )
