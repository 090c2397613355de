"""Compensation tables as the control writes and reads them: text to tables and back, and what is wrong with a text.

Pure. `write_blocks` and `backup` are the strict pair for files of our own programs; all else reads anybody's files
and is never a source to restore from. Signs and units of the control are turned here and nowhere else.
"""
