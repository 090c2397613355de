"""The run: measure, propose, push, measure again, judge; each stage stored before the next begins.

Whole commands are `complete_run` (run, close), `forecast` (its day), `programs` (on paper) and `day` (a folder of
files). Below them each package uses only those after it: `control` (live tables), `results` (reports), `tooth`
(correction, parts), `errors21` (set-ups to one error model), `axes` (one axis), `files` (files of others) and `run`
(what every run shares).
"""
