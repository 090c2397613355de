"""Uncertainty by the GUM: the budget of a positioning test, coverage factors, and Monte Carlo with its distributions.

Called by every room that states U, reports included. The rule: inside, all are standard uncertainties; they become
U = COVERAGE u only where a person reads them, and input given with k = 2 is halved where it comes in.
"""
