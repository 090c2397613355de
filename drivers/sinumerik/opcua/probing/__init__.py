"""What to ask a control so that its double can be compared with it: the written list, and who asks.

Called through the registry by the role "prober". Nothing here moves an axis or leaves a value changed.
"""
