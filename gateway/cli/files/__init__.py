"""Commands on files and stored runs; no machine is needed: evaluate, convert, tables, import, report, runs, study."""
