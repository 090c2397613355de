"""Everything that touches live tables: approve, push, recover, roll back, switch off, compare.

A write needs `--apply`, the machine's name and a line in the audit log before it begins.
"""
