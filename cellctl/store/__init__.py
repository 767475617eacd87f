"""What is kept: parts, plans, programs, proofs, jobs, tokens, audit, events and journal, and the files that they name; on SQLite,
and on PostgreSQL what several cells share."""

from cellctl.store.engine import Store, StoreError, open_store, upgrade

__all__ = ["Store", "StoreError", "open_store", "upgrade"]
