"""Limits of a push beside those of the table itself (`drivers.limits`): age, warmth, repetitions, proofs."""

from __future__ import annotations

from datetime import timedelta

from drivers.limits import Limits

MAX_AGE = timedelta(hours=24)
WARN_AGE = timedelta(hours=4)
MAX_AHEAD = timedelta(minutes=2)
APPROVED_FOR = timedelta(minutes=10)
APPROVED_AHEAD = timedelta(seconds=10)
# A table may be pushed at another temperature than it was measured at, as long as that spoils little of what it
# corrects: never less than normal conditions change in a shift, never more than a machine in use should.
LEAST_DRIFT_K, MOST_DRIFT_K = 2.0, 8.0
SPOILT_SHARE = 0.25
# Of straightness and squareness, which a uniform change of a shift in an ordinary hall leaves as they are.
CROSS_DRIFT_K = 4.0
# 1e-6/K: by so much may the expansion of an axis differ from the one its readings were corrected with (steel, glass).
EXPANSION_DOUBT = 3.5
MIN_REPETITIONS = 3
MAX_SUSPECT_SHARE = 0.1
MAX_REMAINING = 0.5
MAX_REPEATABILITY = 1.0 / 3.0
COARSEST_UM = 1.0
PROOF_WITHIN = 0.2
PROOF_COVERAGE = 2.0
PROOF_TIMES_U = 4.0
# Midway between one and half or twice.
PROOF_SIZES = (0.75, 1.5)

MAX_JUMP = Limits.of("mm").jump
# um or arcsec: by so little temperature compensation may have changed since the measurement.
TEMPERATURE_MOVED = 0.1
