"""What a push leaves on the disk: journals, numbers, locks, programs sent, and what they say afterwards.

Everything is durable before what it announces. Nothing here asks the control.
"""
