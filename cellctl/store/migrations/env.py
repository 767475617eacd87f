"""Alembic's entry: runs the migrations on the engine that `upgrade` hands over."""

from alembic import context

from cellctl.store.schema import metadata

engine = context.config.attributes["engine"]
with engine.connect().execution_options(cellctl_write=True) as connection:
    context.configure(
        connection=connection, target_metadata=metadata, render_as_batch=True, transaction_per_migration=True
    )
    with context.begin_transaction():
        context.run_migrations()
