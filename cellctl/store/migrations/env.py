"""Alembic's entry: runs the migrations on the engine that `upgrade` hands over.

On PostgreSQL all of them are one transaction of a writer: hosts that start at once come one after the other. The tables that the cell
process writes are made there too, and stay empty, as those that people share do in the SQLite file of a store that is shared: one schema.
"""

from contextlib import nullcontext

from alembic import context

from cellctl.store.schema import metadata

engine = context.config.attributes["engine"]
is_one_step = engine.dialect.name == "postgresql"
with engine.connect().execution_options(cellctl_write=True) as connection:
    context.configure(
        connection=connection, target_metadata=metadata, render_as_batch=True, transaction_per_migration=not is_one_step
    )
    with connection.begin() if is_one_step else nullcontext(), context.begin_transaction():
        context.run_migrations()
