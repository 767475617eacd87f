"""Plans, posts and proofs: one worker process each, low priority, capped memory, cancellable; on this machine, or on those of a pool (`pool`)."""
