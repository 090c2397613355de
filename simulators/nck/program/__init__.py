"""The interpreter of NC programs: names, variables, statements, expressions, initialisation files, and the main run."""
