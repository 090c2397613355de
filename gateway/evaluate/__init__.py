"""Readings to figures with U: `geometry` over `behaviour` over `standards` over `optics` and `uncertainty`.

Capture, the workflow's stages and the command line call it. All of it is pure: arrays and frozen records in, the same
out; nothing is read, written, waited for or remembered. A formula of a standard stands here once.
"""
