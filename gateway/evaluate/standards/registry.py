"""Positioning standards by name: evaluation of a test by any of them, and the formulas of those beside ISO 230-2."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message, digits
from drivers.units import DeviationUnit
from gateway.domain.values import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards import iso230_2, statistics
from gateway.evaluate.standards.conformity import Decision, decide
from gateway.evaluate.standards.positioning_trials import TableFormulas, scatter_of_test, too_many
from gateway.evaluate.standards.statistics import RECALLED, SECONDARY, Certainty
from gateway.evaluate.uncertainty.budget import Budget
from gateway.evaluate.uncertainty.montecarlo import TrialOutcome

# ---- Figures of other standards: VDI/DGQ 3441, ASME B5.54-1992, NMTBA, JIS B 6330; gaps are flagged.
#
# Each has a formula on readings (..., m, n, 2), for one test or many trials, and a function that labels it. A gap
# is treated as for ISO 230-2: own n everywhere, a target without one approach out of what needs both, absent
# figures None, everything said in ``flags``.

Values = Mapping[str, FloatArray]
Formulas = Callable[[FloatArray], Values]
JIS_REPETITIONS, JIS_PLACES = 7, 3
# Mean range over sigma of n normal readings (d2 of control charts), for the range estimator of VDI/DGQ 3441.
D2: Final = {2: 1.128, 3: 1.693, 4: 2.059, 5: 2.326, 6: 2.534, 7: 2.704, 8: 2.847, 9: 2.970, 10: 3.078}


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of a standard by its own names, None where absent; ``certainty`` says how sure the formulas are."""

    standard: str
    certainty: Certainty
    values: Mapping[str, float | None]
    flags: tuple[Message, ...] = ()


def vdi3441(deviations: ArrayLike, *, estimator: Literal["n-1", "range"] = "n-1") -> Figures:
    """VDI/DGQ 3441:1977 from deviations (m, n, 2); `estimator` "range" takes s from the mean range over d2.

    Raises ModelError as `readings.checked`; E-EVAL-RANGE-RUNS where no d2 is known for the repetitions.
    """
    x = _check_deviations(deviations)
    s = range_deviations(x) if estimator == "range" else statistics.standard_deviations(x)
    return _flagged_figures("VDI/DGQ 3441:1977", vdi_of_table(statistics.means(x), s), x, "s, Ps, P")


def vdi_of_table(mean: FloatArray, s: FloatArray) -> Values:
    """P_sj = 6 s_j, U_j = |B_j|, P = max(x_j + (U_j + P_sj)/2) - min(x_j - (U_j + P_sj)/2), and the rest."""
    centre, reversal = mean.mean(axis=-1), np.abs(mean[..., 0] - mean[..., 1])
    spread = 6.0 * s.mean(axis=-1)
    half = (reversal + spread) / 2.0
    return {
        "U_max": statistics.largest(reversal),
        "U_mean": statistics.average(reversal),
        "Ps_max": statistics.largest(spread),
        "Ps_mean": statistics.average(spread),
        "Pa": statistics.span(centre, centre),
        "P": statistics.span(centre + half, centre - half),
    }


def range_deviations(x: FloatArray) -> FloatArray:
    """Standard deviations (m, 2) from ranges over d2, NaN where n < 2. Raises ModelError (E-EVAL-RANGE-RUNS)."""
    n = statistics.counts(x)
    if int(n.max()) > max(D2):
        raise ModelError("E-EVAL-RANGE-RUNS", "VDI/DGQ 3441", repetitions=int(n.max()), most=max(D2))
    factor = np.array([D2.get(count, np.nan) for count in range(max(D2) + 1)])[n]
    return np.asarray(_spread(x, -2) / factor)


def asme_b554_1992(deviations: ArrayLike) -> Figures:
    """ASME B5.54-1992: no sigma, spreads and ranges of the readings themselves."""
    x = _check_deviations(deviations)
    return _flagged_figures("ASME B5.54-1992", asme_1992_formulas(x), x, "repeatability")


def asme_1992_formulas(x: FloatArray) -> Values:
    """Largest spread at a target, range of all readings, lost motion from the means; (..., m, n, 2)."""
    mean, n = statistics.means(x), statistics.counts(x)
    repeated = (n > 1).any(axis=-2)
    at_target = np.where(n > 1, _spread(x, -2), np.nan)
    up, down = statistics.largest(at_target[..., 0]), statistics.largest(at_target[..., 1])
    both = (n > 0).all(axis=-1)
    bidirectional = np.where(both, _spread(x, (-2, -1)), np.nan)
    return {
        "rep_up": up,
        "rep_down": down,
        "rep_bi": np.where(repeated.all(axis=-1), statistics.largest(bidirectional), np.nan),
        "acc_up": _spread(x[..., 0], (-2, -1)),
        "acc_down": _spread(x[..., 1], (-2, -1)),
        "acc_bi": np.where(n.any(axis=-2).all(axis=-1), _spread(x, (-3, -2, -1)), np.nan),
        "lost_motion": statistics.largest(np.abs(mean[..., 0] - mean[..., 1])),
    }


def _spread(x: FloatArray, axis: int | tuple[int, ...]) -> FloatArray:
    return np.asarray(np.fmax.reduce(x, axis=axis) - np.fmin.reduce(x, axis=axis))


def nmtba(deviations: ArrayLike, *, offset: bool = True) -> Figures:
    """NMTBA 1972, 3 sigma; every value is the half width of a +/- band; `offset` centres the band."""
    x = _check_deviations(deviations)
    return _flagged_figures("NMTBA:1972", nmtba_of_table(*statistics.moments(x), offset=offset), x, "s, R, A")


def nmtba_of_table(mean: FloatArray, s: FloatArray, *, offset: bool = True) -> Values:
    """A from x +/- 3 s, R_bi = (|B_i| + 3 s+ + 3 s-)/2; half widths; means and s (..., m, 2)."""
    both = np.isfinite(s).any(axis=-2).all(axis=-1)
    high, low = mean + 3.0 * s, mean - 3.0 * s
    names = (("A_up", slice(0, 1)), ("A_down", slice(1, 2)), ("A_bi", slice(0, 2)))
    values = {name: _half(high[..., part], low[..., part], offset) for name, part in names}
    reversal = np.abs(mean[..., 0] - mean[..., 1])
    return values | {
        "A_bi": np.where(both, values["A_bi"], np.nan),
        "R_up": statistics.largest(3.0 * s[..., 0]),
        "R_down": statistics.largest(3.0 * s[..., 1]),
        "R_bi": statistics.largest((reversal + 3.0 * s.sum(axis=-1)) / 2.0),
    }


def _half(high: FloatArray, low: FloatArray, offset: bool) -> FloatArray:
    if offset:
        return statistics.whole_span(high, low) / 2.0
    ends = np.stack([high, low], axis=-1)
    return np.asarray(np.fmax.reduce(np.abs(ends), axis=(-3, -2, -1)))


def jis_of_test(deviations: ArrayLike) -> Figures:
    """JIS B 6330:1980 of an ordinary test (m, n, 2): first passes for accuracy, every target a place; flagged."""
    x = _check_deviations(deviations)
    found = _flagged_figures("JIS B 6330:1980", jis_formulas(x), x, "repeatability", JIS_REPETITIONS)
    return Figures(found.standard, found.certainty, found.values, (*found.flags, *_jis_flags(x.shape[0])))


def jis_formulas(x: FloatArray) -> Values:
    """Accuracy: range of the first pass, the worse direction; repeatability: half the largest spread."""
    mean, n = statistics.means(x), statistics.counts(x)
    at_target = np.where(n > 1, _spread(x, -2), np.nan)
    return {
        "accuracy": statistics.largest(_spread(x[..., 0, :], -2)),
        "repeatability": np.asarray(np.fmax.reduce(at_target, axis=(-2, -1)) / 2.0),
        "lost_motion": statistics.largest(np.abs(mean[..., 0] - mean[..., 1])),
    }


def _jis_flags(places: int) -> tuple[Message, ...]:
    return (Message.of("S-EVAL-PLACES", places=places, wanted=JIS_PLACES),) if places != JIS_PLACES else ()


def _check_deviations(deviations: ArrayLike) -> FloatArray:
    x = np.asarray(deviations, dtype=np.float64)
    return statistics.check_readings(np.arange(x.shape[0] if x.ndim else 0), x)[1]


def _flagged_figures(standard: str, values: Values, x: FloatArray, lost: str, wanted: int = 5) -> Figures:
    flags = statistics.gaps(statistics.counts(x), wanted, lost)
    return Figures(standard, RECALLED, statistics.stated_values(values), flags)


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
    says: Message = field(default_factory=lambda: Message.stored(""))


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


def band_of(name: str, deviations: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """What a standard counts at each target of deviations (m, n, 2): lowest and highest (m,), in their unit.

    The span over all targets is its accuracy: means -/+ 2 s of both directions for ISO 230-2 and its equivalents (3 s
    in 1988), mean of both -/+ half of reversal and 6 s for VDI/DGQ 3441, means -/+ 3 s for NMTBA (A is half of it),
    the readings for ASME B5.54-1992, those of the first pass for JIS B 6330. NaN where a target has none. Raises
    ModelError as `standard` and `readings.checked`.
    """
    chosen, x = standard(name), _check_deviations(deviations)
    if chosen.name.startswith("VDI"):
        mean = statistics.means(x)
        s = range_deviations(x) if chosen.name.endswith("range") else statistics.standard_deviations(x)
        half = (np.abs(mean[:, 0] - mean[:, 1]) + 6.0 * s.mean(axis=-1)) / 2.0
        return mean.mean(axis=-1) - half, mean.mean(axis=-1) + half
    if chosen.name.startswith(("ASME B5.54-1992", "JIS B 6330")):
        seen = x[:, :1] if chosen.name.startswith("JIS") else x
        return np.fmin.reduce(seen, axis=(1, 2)), np.fmax.reduce(seen, axis=(1, 2))
    mean, s = statistics.moments(x)
    k = iso230_2.sigmas(chosen.iso) if chosen.iso else 3.0
    return np.fmin.reduce(mean - k * s, axis=-1), np.fmax.reduce(mean + k * s, axis=-1)


_YEAR = re.compile(r"(19|20)\d\d")
_VDI = ("U_max", "U_mean", "Ps_max", "Ps_mean", "Pa", "P")
_ASME = ("rep_up", "rep_down", "rep_bi", "acc_up", "acc_down", "acc_bi", "lost_motion")
_NMTBA = ("A_up", "A_down", "A_bi", "R_up", "R_down", "R_bi")
_JIS = ("accuracy", "repeatability", "lost_motion")
_ISO_SAYS = {
    "1988": Message.of("S-STD-3S"),
    "1997": Message.of("S-STD-2S"),
    "2006": Message.of("S-STD-2SU"),
    "2014": Message.of("S-STD-2SU"),
}


def _equal(name: str, iso: str, certainty: Certainty = SECONDARY, says: Message | None = None) -> PositioningStandard:
    edition = name[-4:] if _YEAR.fullmatch(name[-4:]) else iso
    return PositioningStandard(
        name=name,
        edition=edition,
        certainty=certainty,
        parameters=statistics.NAMES,
        iso=iso,
        says=says or Message.of("S-STD-EQUAL", iso=f"ISO 230-2:{iso}"),
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
    _equal("ASME B5.54-2005", "1997", RECALLED, Message.of("S-STD-PARAMETERS-APART")),
    _equal("ASME B5.57", "1997", RECALLED, Message.of("S-STD-PARAMETERS")),
    PositioningStandard("ASME B5.54-1992", "1992", RECALLED, _ASME, says=Message.of("S-STD-ASME")),
    PositioningStandard("VDI/DGQ 3441:1977", "1977", RECALLED, _VDI, says=Message.of("S-STD-VDI")),
    PositioningStandard("VDI/DGQ 3441:1977 range", "1977", RECALLED, _VDI, says=Message.of("S-STD-VDI-RANGE")),
    PositioningStandard("NMTBA:1972", "1972", RECALLED, _NMTBA, says=Message.of("S-STD-NMTBA")),
    PositioningStandard("NMTBA:1972 without offset", "1972", RECALLED, _NMTBA, says=Message.of("S-STD-NMTBA-ZERO")),
    PositioningStandard("JIS B 6330:1980", "1980", RECALLED, _JIS, says=Message.of("S-STD-JIS")),
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
    at, x = statistics.check_readings(targets, deviations)
    if float(at.min()) == float(at.max()):
        least = iso230_2.minimum_targets("linear" if unit == "um" else "rotary", 1.0)[0]
        raise ModelError("E-EVAL-ONE-TARGET", "evaluate", at=digits(at[0], 6), least=least)
    costs = budget or Budget()
    values, by_law, flags = _figures(chosen, at, x, unit, costs)
    formulas, of_table = _formulas(chosen)
    outcomes = (
        scatter_of_test(at, x, unit=unit, formulas=formulas, budget=costs, of_table=of_table, seed=seed)
        if monte_carlo
        else {}
    )
    by_trials = {key: outcome.U for key, outcome in outcomes.items() if values.get(key) is not None}
    many = (Message.of("S-EVAL-TOO-MANY", count=at.size),) if monte_carlo and too_many(x, of_table) else ()
    notes = (*flags, *many, *unsettled_notes(outcomes))
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
        found = iso230_2.evaluate_iso230_2(at, x, unit, edition=chosen.iso, budget=budget)
        return {key: getattr(found, key) for key in statistics.NAMES}, found.U, found.flags
    other = _OTHERS[chosen.name][0](x)
    return other.values, {}, other.flags


def _formulas(chosen: PositioningStandard) -> tuple[Formulas | None, TableFormulas | None]:
    """The formulas on readings, or those on their means and standard deviations where these are enough."""
    if chosen.iso:
        return None, partial(statistics.parameters_of_moments, k=iso230_2.sigmas(chosen.iso))
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
