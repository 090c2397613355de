"""Commands on files at a desk; no machine is needed: evaluate, convert, lint, import, replay, study, watch."""
