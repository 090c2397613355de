"""One registry of positioning standards by name, and the evaluation of a test by any of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from numpy.typing import ArrayLike

from drivers.message import Message
from drivers.units import DeviationUnit
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards import iso230_2, parameters, readings
from gateway.evaluate.standards.certainty import RECALLED, SECONDARY, Certainty
from gateway.evaluate.standards.decision import Decision, decide
from gateway.evaluate.standards.other_standards import (
    Figures,
    Formulas,
    asme_1992_formulas,
    asme_b554_1992,
    jis_formulas,
    jis_of_test,
    nmtba,
    nmtba_of_table,
    vdi3441,
    vdi_of_table,
)
from gateway.evaluate.standards.positioning_trials import TableFormulas, scatter_of_test
from gateway.evaluate.uncertainty.budget import Budget
from gateway.evaluate.uncertainty.montecarlo import TrialOutcome


@dataclass(frozen=True, slots=True)
class PositioningStandard:
    """A standard in one edition. ``iso`` is the edition of ISO 230-2 whose formulas it has, "" for its own.

    ``certainty`` is of the formulas; for a national equivalent also of the equivalence.
    """

    name: str
    edition: str
    certainty: Certainty
    parameters: tuple[str, ...]
    iso: str = ""
    says: str = ""


@dataclass(frozen=True, slots=True)
class StandardResult:
    """A test by a standard: values by the standard's own names (None where absent), U (k = 2), Monte Carlo.

    ``U`` is by the law of propagation where it is known, else half the Monte Carlo interval; ``trials`` holds the
    Monte Carlo outcomes themselves.
    """

    standard: PositioningStandard
    unit: DeviationUnit
    targets: int
    repetitions: int
    values: Mapping[str, float | None]
    U: Mapping[str, float]
    trials: Mapping[str, TrialOutcome]
    flags: tuple[Message, ...] = ()

    def decided(self, limits: Mapping[str, float]) -> tuple[Decision, ...]:
        """Verdicts on the limits given. Raises ModelError (E-EVAL-LIMIT-NAME, E-EVAL-LIMIT)."""
        for name in limits:
            if name not in self.values:
                raise ModelError("E-EVAL-LIMIT-NAME", self.standard.name, parameter=name, known=", ".join(self.values))
        return tuple(self._decision(name, limit) for name, limit in limits.items())

    def _decision(self, name: str, limit: float) -> Decision:
        repeated = self.trials.get(name)
        interval = None if repeated is None else repeated.symmetric
        return decide(name, self.values[name], U=self.U.get(name), limit=limit, trials=interval)


_YEAR = re.compile(r"(19|20)\d\d")
_VDI = ("U_max", "U_mean", "Ps_max", "Ps_mean", "Pa", "P")
_ASME = ("rep_up", "rep_down", "rep_bi", "acc_up", "acc_down", "acc_bi", "lost_motion")
_NMTBA = ("A_up", "A_down", "A_bi", "R_up", "R_down", "R_bi")
_JIS = ("accuracy", "repeatability", "lost_motion")
_ISO_SAYS = {
    "1988": "3 s",
    "1997": "2 s",
    "2006": "2 s, uncertainty stated",
    "2014": "2 s, uncertainty stated",
}


def _equal(name: str, iso: str, certainty: Certainty = SECONDARY, says: str = "") -> PositioningStandard:
    edition = name[-4:] if _YEAR.fullmatch(name[-4:]) else iso
    return PositioningStandard(
        name=name,
        edition=edition,
        certainty=certainty,
        parameters=parameters.NAMES,
        iso=iso,
        says=says or f"= ISO 230-2:{iso}",
    )


_STANDARDS = (
    *(_equal(f"ISO 230-2:{edition}", edition, SECONDARY, says) for edition, says in reversed(_ISO_SAYS.items())),
    _equal("DIN ISO 230-2", "2014"),
    _equal("BS ISO 230-2", "2014"),
    _equal("SN ISO 230-2", "2014"),
    _equal("GB/T 17421.2-2000", "1997"),
    _equal("GB/T 17421.2-2016", "2006"),
    _equal("GB/T 17421.2-2023", "2014", RECALLED),
    _equal("GB 10931-89", "1988", RECALLED),
    _equal("JIS B 6190-2:2008", "2006"),
    _equal("JIS B 6190-2:2016", "2014"),
    _equal("JIS B 6192", "1997", RECALLED),
    _equal("GOST 27843-2006", "1997"),
    _equal("GOST ISO 230-2-2016", "2014"),
    _equal("BS 4656-16", "1988", RECALLED),
    _equal("BS 3800-3", "1988", RECALLED),
    _equal("ASME B5.54-2005", "1997", RECALLED, "parameters of ISO 230-2:1997; its periodic error and drift apart"),
    _equal("ASME B5.57", "1997", RECALLED, "parameters of ISO 230-2:1997"),
    PositioningStandard(
        "ASME B5.54-1992", "1992", RECALLED, _ASME, says="spreads and ranges of the readings, no sigma"
    ),
    PositioningStandard("VDI/DGQ 3441:1977", "1977", RECALLED, _VDI, says="6 s, position scatter and uncertainty"),
    PositioningStandard("VDI/DGQ 3441:1977 range", "1977", RECALLED, _VDI, says="as 3441, s from mean ranges over d2"),
    PositioningStandard("NMTBA:1972", "1972", RECALLED, _NMTBA, says="3 s, half widths, band centred (with offset)"),
    PositioningStandard("NMTBA:1972 without offset", "1972", RECALLED, _NMTBA, says="3 s, half widths about zero"),
    PositioningStandard("JIS B 6330:1980", "1980", RECALLED, _JIS, says="one pass; half spread of repeated readings"),
)


def standards() -> tuple[PositioningStandard, ...]:
    """Every standard that can be asked for, the newest ISO 230-2 first."""
    return _STANDARDS


def standard(name: str) -> PositioningStandard:
    """The standard of this name; spaces, marks and case do not matter, nor who publishes it where that is plain.

    A bare year is that edition of ISO 230-2; a name without edition is its newest. Raises ModelError
    (E-EVAL-STANDARD) with the names known.
    """
    asked = _plain(name)
    for found in _STANDARDS:
        if asked == _plain(found.name) or (found.name.startswith("ISO") and asked == found.edition):
            return found
    family = [found for found in _STANDARDS if _family(found) == asked]
    ending = [found for found in _STANDARDS if _plain(found.name).endswith(asked) or _family(found).endswith(asked)]
    if len(asked) < 4 or _YEAR.fullmatch(asked) or not ending:
        raise ModelError("E-EVAL-STANDARD", "standards", standard=name, known="; ".join(s.name for s in _STANDARDS))
    return max(family or ending, key=lambda found: found.edition)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9.]", "", name.lower().replace("vdi/dgq", "vdi"))


def _family(found: PositioningStandard) -> str:
    return _plain(re.sub(r"[:-](19|20)\d\d$", "", found.name))


def evaluate_by(
    name: str,
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    *,
    budget: Budget | None = None,
    seed: int = 1,
    monte_carlo: bool = True,
) -> StandardResult:
    """Evaluate deviations (m, n, 2), approach + then -, NaN where missing, in `unit`, by a standard.

    Raises ModelError as `standard` and `readings.checked`, and E-EVAL-ONE-TARGET where all targets are one place: no
    standard has figures for a travel of nothing.
    """
    chosen = standard(name)
    at, x = readings.checked(targets, deviations)
    if float(at.min()) == float(at.max()):
        least = iso230_2.minimum_targets("linear" if unit == "um" else "rotary", 1.0)[0]
        raise ModelError("E-EVAL-ONE-TARGET", "evaluate", at=f"{at[0]:g}", least=least)
    costs = budget or Budget()
    values, by_law, flags = _figures(chosen, at, x, unit, costs)
    formulas, of_table = _formulas(chosen)
    outcomes = (
        scatter_of_test(at, x, unit=unit, formulas=formulas, budget=costs, of_table=of_table, seed=seed)
        if monte_carlo
        else {}
    )
    by_trials = {key: outcome.U for key, outcome in outcomes.items() if values.get(key) is not None}
    notes = (*flags, *unsettled_notes(outcomes))
    return StandardResult(
        standard=chosen,
        unit=unit,
        targets=at.size,
        repetitions=x.shape[1],
        values=values,
        U={**by_trials, **by_law},
        trials=outcomes,
        flags=notes,
    )


def _figures(
    chosen: PositioningStandard, at: FloatArray, x: FloatArray, unit: DeviationUnit, budget: Budget
) -> tuple[Mapping[str, float | None], Mapping[str, float], tuple[Message, ...]]:
    if chosen.iso:
        found = iso230_2.evaluate(at, x, unit, edition=chosen.iso, budget=budget)
        return {key: getattr(found, key) for key in parameters.NAMES}, found.U, found.flags
    other = _OTHERS[chosen.name][0](x)
    return other.values, {}, other.flags


def _formulas(chosen: PositioningStandard) -> tuple[Formulas | None, TableFormulas | None]:
    """The formulas on readings, or those on their means and standard deviations where these are enough."""
    if chosen.iso:
        return None, partial(parameters.of_table, k=iso230_2.sigmas(chosen.iso))
    return _OTHERS[chosen.name][1:]


_OTHERS: Mapping[str, tuple[Callable[[FloatArray], Figures], Formulas | None, TableFormulas | None]] = {
    "ASME B5.54-1992": (asme_b554_1992, asme_1992_formulas, None),
    "VDI/DGQ 3441:1977": (vdi3441, None, vdi_of_table),
    "VDI/DGQ 3441:1977 range": (partial(vdi3441, estimator="range"), None, vdi_of_table),
    "NMTBA:1972": (nmtba, None, nmtba_of_table),
    "NMTBA:1972 without offset": (partial(nmtba, offset=False), None, partial(nmtba_of_table, offset=False)),
    "JIS B 6330:1980": (jis_of_test, jis_formulas, None),
}


def unsettled_notes(outcomes: Mapping[str, TrialOutcome]) -> tuple[Message, ...]:
    """The parameters whose Monte Carlo interval was still moving when the trials ended."""
    moving = [name for name, outcome in outcomes.items() if not outcome.converged]
    return (Message.of("S-EVAL-TRIALS", names=", ".join(moving), trials=outcomes[moving[0]].trials),) if moving else ()
