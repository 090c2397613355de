"""Files of others: read as was said about them, evaluated, imported into the store, exported from it."""
