"""What stands on the table after a run, written down: surface, figures with verdict, picture."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import trimesh

from sim.compare import measure
from sim.deviation import Deviation
from sim.picture import picture
from sim.process.field import Field
from sim.process.stock import Stock
from sim.process.surface import built_mesh
from sim.process.target import Target
from sim.proof import is_within

STL_NAME, JSON_NAME, PNG_NAME, FIELD_NAME = "as_built.stl", "as_built.json", "as_built.png", "as_built.npz"


def verdict(deviation: Deviation, tolerance_mm: float) -> dict[str, float | bool]:
    """The figures, the tolerance and `passed`: 99 % of the surface within the tolerance and no more metal missing than a proof allows."""
    return {**deviation.as_dict(), "tolerance_mm": tolerance_mm, "passed": is_within(deviation, tolerance_mm)}


def write(stock: Stock, target: Target, tolerance_mm: float, directory: Path, name: str) -> dict[str, float | bool]:
    """Measure the stock and write `as_built.stl`, `as_built.json` and `as_built.png` into `directory`; returns what the JSON holds.

    target : the part, in the frame of the stock   tolerance_mm : bound on the 99th percentile   name : of the part, for the picture
    Raises OSError when the directory cannot be written. Without any metal above the plate no STL is written.
    """
    measured = measure(stock, target, tolerance_mm=tolerance_mm)
    figures = verdict(measured.whole, tolerance_mm)
    vertices, facets = built_mesh(stock, 0.0)
    directory.mkdir(parents=True, exist_ok=True)
    (directory / STL_NAME).unlink(missing_ok=True)
    if len(facets):
        trimesh.Trimesh(vertices, facets, process=False).export(directory / STL_NAME)
    (directory / JSON_NAME).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    (directory / PNG_NAME).write_bytes(picture(stock, target, measured.whole, tolerance_mm, name, measured.built))
    return figures


def write_field(field: Field, directory: Path) -> None:
    """Write the metal itself to `as_built.npz` in `directory`, for `read_field`. Raises OSError when it cannot be written."""
    directory.mkdir(parents=True, exist_ok=True)
    grid = {"origin_mm": field.origin, "cell_and_band_mm": np.array([field.cell_mm, field.band_mm]), "cells": np.array(field.shape)}
    np.savez_compressed(directory / FIELD_NAME, allow_pickle=False, **grid, **field.snapshot())


def read_field(path: Path) -> Field:
    """The metal of a file of `write_field`. Raises OSError when it cannot be read, ValueError when it is no such file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            cell_mm, band_mm = file["cell_and_band_mm"].tolist()
            field = Field(file["origin_mm"], cell_mm, band_mm, file["cells"])
            field.restore({name: file[name] for name in ("directory", "value", "mark")})
    except (KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: holds no field of an as-built: {error}") from None
    return field
