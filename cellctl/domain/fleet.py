"""When a cell of the fleet counts as alive, as silent and as dead, by the age of its last heartbeat."""

from __future__ import annotations

HEARTBEAT_S = 2.0  # each web process writes its cell's row this often
LEASE_S = 10.0  # five heartbeats: a service heard within it owns its cell, and no second one starts
DEAD_S = 30.0  # a host that restarts is back by then; one that is not gives its waiting jobs to the others
ANY = "any"  # what a job says that may be made on whichever cell it fits


def is_living(age_s: float) -> bool:
    """Whether a cell heard this long ago is given work, and its service keeps others from its cell."""
    return age_s < LEASE_S


def is_dead(age_s: float) -> bool:
    """Whether jobs that were given to a cell heard this long ago are given to others."""
    return age_s >= DEAD_S
