"""Questions to a control whose answers are compared with the simulator's: the written lists, and who asks them.

Called through the registry by the role "prober". Nothing here moves an axis or leaves a value changed.
"""
