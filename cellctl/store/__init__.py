"""What is kept: parts, plans, programs, proofs, jobs, tokens, audit, events and journal, on SQLite, and the files that they name."""

from cellctl.store.engine import Store, StoreError, open_store, upgrade

__all__ = ["Store", "StoreError", "open_store", "upgrade"]
