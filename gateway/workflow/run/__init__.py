"""What every run shares: devices and store as one context, its folder, stages, audit log, self-tests and live tables.

`stages`, `folder`, `outcome` and `paper_control` open no device and know no push: whoever reads a run loads them alone.
"""
