"""What alembic runs: every step that the index has not seen yet, on the connection that opened it."""

from __future__ import annotations

from alembic import context

context.configure(connection=context.config.attributes["connection"])
with context.begin_transaction():
    context.run_migrations()
