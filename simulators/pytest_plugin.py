"""The `trueflank_cell` fixture: a simulated cell for a test, with its truth by a back door."""
