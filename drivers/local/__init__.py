"""This PC: what may be a name, our own files opened safely, TOML within bounds, secrets out of what is kept.

No device and no control is known here; everybody may call it.
"""
