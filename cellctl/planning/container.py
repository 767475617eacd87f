"""Arrays with a JSON header in one block of bytes, as the console's worker reads it: little-endian, each array at a multiple of 4."""

from __future__ import annotations

import struct
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

MAGIC = b"HCV2"
TYPES = {"u1": 1, "i1": 1, "u2": 2, "i2": 2, "u4": 4, "i4": 4, "f4": 4}
ALIGNMENT = 4


class ContainerError(ValueError):
    """The bytes are no container, or it is damaged."""


def pack(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    """Bytes of a header and arrays of one of TYPES each; shapes go into the header under "arrays": name -> [type, offset, shape].

    Layout: "HCV2", length of the JSON (u32), JSON padded with blanks, arrays. Offsets count from the end of the JSON.
    Raises ContainerError for another type of array.
    """
    places: dict[str, list[Any]] = {}
    blocks: list[bytes] = []
    offset = 0
    for name, values in arrays.items():
        kind = values.dtype.str[1:]
        if kind not in TYPES:
            raise ContainerError(f"{name}: no array of {values.dtype} can be packed")
        places[name] = [kind, offset, list(values.shape)]
        block = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
        block += bytes(-len(block) % ALIGNMENT)
        blocks.append(block)
        offset += len(block)
    text = msgspec.json.encode({**header, "arrays": places})
    text += b" " * (-len(text) % 8)
    return b"".join([MAGIC, struct.pack("<I", len(text)), text, *blocks])


def unpack(content: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays (views of the bytes). Raises ContainerError."""
    if len(content) < 8 or content[:4] != MAGIC:
        raise ContainerError("no view of this version")
    (length,) = struct.unpack_from("<I", content, 4)
    try:
        header: dict[str, Any] = msgspec.json.decode(content[8 : 8 + length])
        arrays = {}
        for name, (kind, offset, shape) in header.pop("arrays").items():
            count = int(np.prod(shape, dtype=np.int64))
            arrays[name] = np.frombuffer(content, f"<{kind}", count, 8 + length + offset).reshape(shape)
    except (msgspec.DecodeError, KeyError, ValueError, TypeError) as error:
        raise ContainerError(f"a damaged view: {error}") from None
    return header, arrays


def quantised(points: NDArray[Any], extra: NDArray[Any]) -> tuple[list[float], float, NDArray[np.uint16]]:
    """(origin (3,) mm, step mm, (n, 4) u2): points (n, 3) mm in steps from the origin, and `extra` (n,) beside them.

    One step for all axes: at most 1/65535 of the longest side, so that directions stay as they are.
    """
    rows = np.zeros((len(points), 4), dtype=np.uint16)
    rows[:, 3] = extra
    if not len(points):
        return [0.0, 0.0, 0.0], 1.0, rows
    low = points.min(axis=0)
    step = max(float(np.ptp(points, axis=0).max()) / 65535.0, 1e-9)
    rows[:, :3] = np.minimum(np.rint((points - low) / step), 65535.0)
    return [float(value) for value in low], step, rows
