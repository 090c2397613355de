"""LinuxCNC: an agent on its host and the Controller that talks to it; screw files, programs, hand-shake.

Only the registry and tests come here. Room rule: agent knows the standard library and LinuxCNC's own modules, the rest
knows the agent by its lines alone.
"""
