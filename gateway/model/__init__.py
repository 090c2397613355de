"""Machine model: `transforms` < `chain` < `frames`, `stroke`; `components` < `motion`, `fit` < `waves`; `error_model`.

Called by gear, evaluation, correction and the studies. The rule: chains are in mm and rad, fitted components in um or
arcsec over mm or deg; `motion` and `error_model` convert between them.
"""
