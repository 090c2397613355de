"""Dial gauges and inductive probes behind a display that answers a question over a serial line: Mahr, TESA, Sylvac.

``codec`` is their lines to messages and back; ``device`` is the instrument, ``settings`` its keys in the site file. The
registry loads it; nothing else may call it.
"""
