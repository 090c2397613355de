"""The run: measure, propose, push, measure again, judge; each stage stored before the next begins."""
