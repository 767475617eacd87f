"""The raw samples of a run: columns of the journal as arrays, and as a Parquet file whose columns know their units."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from sqlalchemy import Column, Connection, Float, Integer, select

from cellctl.store.schema import journal

BATCH_ROWS = 50_000  # held in memory at a time
UNITS = {
    "_w": "W", "_g_min": "g/min", "_l_min": "L/min", "_mm_s": "mm/s", "_mm_min": "mm/min", "_mm": "mm", "_rpm": "1/min", "_percent": "%",
    "_ms": "ms", "_s": "s", "_deg": "deg",
}  # fmt: skip
NAMED = {"at": "s since 1970-01-01 UTC", "tip_x": "mm", "tip_y": "mm", "tip_z": "mm", "executed_line": "1", "layer": "1"}


def unit_of(name: str) -> str:
    """Unit of a column by its name's end; empty for words and counts."""
    return NAMED.get(name) or next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def _kind(column: Column[Any]) -> pa.DataType:
    if isinstance(column.type, Integer):
        return pa.int64()
    return pa.float64() if isinstance(column.type, Float) else pa.string()


def schema_of(job: str) -> pa.Schema:
    """Columns of the file: those of the journal. Each carries its `unit`, the file its `job`."""
    fields = [pa.field(column.name, _kind(column), metadata={"unit": unit_of(column.name)}) for column in journal.columns if column.name != "job"]
    return pa.schema(fields, metadata={"job": job, "source": "journal of the cell process"})


def batches(connection: Connection, job: str) -> Iterator[pa.RecordBatch]:
    """The samples of a job in order, BATCH_ROWS at a time."""
    schema = schema_of(job)
    wanted = [journal.c[name] for name in schema.names]
    last = -1
    while True:
        query = select(*wanted).where(journal.c.job == job, journal.c.id > last).order_by(journal.c.id).limit(BATCH_ROWS)
        rows = connection.execute(query).all()
        if not rows:
            return
        last = rows[-1][schema.names.index("id")]
        yield pa.RecordBatch.from_arrays(
            [pa.array(column, type=field.type) for column, field in zip(zip(*rows, strict=True), schema, strict=True)], schema=schema
        )


def write_parquet(connection: Connection, job: str, path: Path) -> int:
    """Write the samples of a job; how many there are. A job without samples gets a file without rows."""
    count = 0
    with pq.ParquetWriter(path, schema_of(job), compression="zstd") as writer:
        for batch in batches(connection, job):
            writer.write_batch(batch)
            count += batch.num_rows
    return count


def columns_of(path: Path, names: list[str]) -> dict[str, NDArray[np.float64]]:
    """Columns of a written file as float arrays (n,); what was not known is NaN, a column that is not there is left out."""
    there = [name for name in names if name in pq.read_schema(path).names]
    table = pq.read_table(path, columns=there)
    return {name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in there}
