"""Limits of a push beside those of the table itself (`drivers.limits`): age, warmth, repetitions, proofs."""

from __future__ import annotations

from datetime import timedelta

from drivers.limits import Limits

MAX_AGE = timedelta(hours=24)
WARN_AGE = timedelta(hours=4)
MAX_AHEAD = timedelta(minutes=2)
APPROVED_FOR = timedelta(minutes=10)
APPROVED_AHEAD = timedelta(seconds=10)
MAX_DRIFT_K = 2.0
MIN_REPETITIONS = 3
MAX_SUSPECT_SHARE = 0.1
MAX_REMAINING = 0.5
MAX_REPEATABILITY = 1.0 / 3.0
COARSEST_UM = 1.0
PROOF_WITHIN = 0.2
PROOF_TIMES_U = 4.0

MAX_JUMP = Limits.of("mm").jump
# um or arcsec: by so little temperature compensation may have changed since the measurement.
TEMPERATURE_MOVED = 0.1
