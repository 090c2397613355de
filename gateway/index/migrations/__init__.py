"""The index brought from one version of its tables to the next; run by alembic when an index is opened."""
