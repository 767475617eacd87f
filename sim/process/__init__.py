"""Metal: what the melt pool adds and what the cutter takes away."""
