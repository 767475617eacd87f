"""Plans, posts and proofs on other machines: a pool of planning machines behind a dask scheduler. The stages are those of `cellctl.planning.stages`.

| file | what it knows |
|---|---|
| `order.py` | what goes between the two ends: the order, its files, its end |
| `wire.py` | the scheduler's address, and the TLS files of the pool |
| `near.py` | the engine that the service uses: starts the link and asks it |
| `link.py` | the link, a process beside the web process: talks with the scheduler, so that the web process never loads dask |
| `connection.py` | one connection to the scheduler, and what machines it has |
| `attempt.py` | one order on the pool: sent, fed with files, followed, its results fetched |
| `packing.py` | a task of this machine as an order: files by their hash |
| `cache.py` | the files that a planning machine keeps, by their hash |
| `unpacking.py` | an order as a task of the planning machine |
| `machine.py` | a planning machine: `cellctl planner-worker` |
| `far.py` | what the scheduler and the link call on a planning machine |
| `scheduler.py` | a scheduler of one's own: `cellctl planner-scheduler` |

Only `connection.py`, `machine.py`, `scheduler.py` and, for them, `wire.py` import dask's `distributed`, an optional extra, when they are called.
Files go as bytes with their hashes, everything else as JSON; but dask itself pickles what it sends, so whoever reaches the scheduler can run
code on all of the pool, services included.
"""
