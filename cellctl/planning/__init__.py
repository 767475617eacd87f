"""Plans, posts and proofs: one worker process each, low priority, capped memory, cancellable."""
