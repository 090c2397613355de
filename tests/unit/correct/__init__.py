"""Corrections: optimum, signs, limits, noise, layers."""
