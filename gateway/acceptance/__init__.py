"""Acceptance at the bench and at the machine: the same checks of a site, within an allowance, and a sheet to sign.

Called by `doctor accept` and by the pytest plugin that ships with it. Writes through the push's own transaction.
"""
