"""From an inspected part back to the machine: A, B, G at each wheel place, corrections, set-up values, the guard.

Called by the workflow's inspections. The rule: a part tells its clamping together with the machine; what cannot be told
apart is said and goes into no table.
"""
