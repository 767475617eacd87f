"""A small picture of a mesh: points strewn over its surface, the nearest of each pixel kept, shaded by their normals, as PNG."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

SIZE_PX = (240, 180)
_FINER = 2  # samples per pixel and direction, averaged: smooth edges
_PER_SAMPLE = 9  # points for each sample that the surface may cover: gaps are rarer than one in ten thousand
_MARGIN = 0.92  # of the picture that the part fills
_EYE = np.array([0.55, -0.75, 0.45])  # from the part to the eye, part frame
_LIGHT = np.array([0.35, -0.5, 0.8])
_DARK, _BRIGHT = np.array([58.0, 74.0, 90.0]), np.array([196.0, 212.0, 226.0])  # RGB: seen on dark and on light ground


def png_of(mesh: Mesh) -> bytes:
    """The mesh seen from above its corner, on clear ground.  The same mesh gives the same bytes."""
    return _png(_picture(mesh))


def _picture(mesh: Mesh) -> NDArray[np.uint8]:
    """(height, width, 4) uint8   RGBA"""
    width, height = SIZE_PX[0] * _FINER, SIZE_PX[1] * _FINER
    eye = _EYE / np.linalg.norm(_EYE)
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(eye, right), eye])
    seen = mesh.normals @ eye > 0.0
    corners = mesh.corners @ axes.T
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    scale = _MARGIN * min(width / max(high[0] - low[0], 1e-9), height / max(high[1] - low[1], 1e-9))
    points, normals = _strewn(corners[seen], mesh.normals[seen], mesh.areas[seen] * (mesh.normals[seen] @ eye) * scale**2)
    at = (points[:, :2] - 0.5 * (low + high)) * scale + 0.5 * np.array([width, height])
    column, row = at[:, 0].astype(np.int64), (height - at[:, 1]).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    cell = (row * width + column)[inside]
    order = np.argsort(points[inside, 2], kind="stable")  # the nearest is written last
    shade = np.full(width * height, np.nan)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    shade[cell[order]] = np.clip(0.15 + 0.85 * np.abs(normals[inside] @ light), 0.0, 1.0)[order]
    return _averaged(shade.reshape(height, width))


def _strewn(corners: Floats, normals: Floats, seen_px: Floats) -> tuple[Floats, Floats]:
    """Points on facets, as many as each covers samples, (n, 3), and the normal at each, part frame."""
    chance = np.random.default_rng(1)
    count = np.maximum(np.ceil(_PER_SAMPLE * seen_px), 1).astype(np.int64)
    facet = np.repeat(np.arange(len(corners)), count)
    u, v = chance.random(len(facet)), chance.random(len(facet))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    first = corners[facet, 0]
    points = first + u[:, None] * (corners[facet, 1] - first) + v[:, None] * (corners[facet, 2] - first)
    return points, normals[facet]


def _averaged(shade: Floats) -> NDArray[np.uint8]:
    """Samples to pixels: colour by the mean of those that show the part, opacity by their share."""
    height, width = shade.shape[0] // _FINER, shade.shape[1] // _FINER
    blocks = shade.reshape(height, _FINER, width, _FINER).transpose(0, 2, 1, 3).reshape(height, width, -1)
    shows = np.isfinite(blocks)
    share = shows.mean(axis=2)
    mean = np.where(shows, blocks, 0.0).sum(axis=2) / np.maximum(shows.sum(axis=2), 1)
    picture = np.zeros((height, width, 4))
    picture[..., :3] = _DARK + mean[..., None] * (_BRIGHT - _DARK)
    picture[..., 3] = 255.0 * share
    return np.asarray(picture.round(), dtype=np.uint8)


def _png(picture: NDArray[np.uint8]) -> bytes:
    """RGBA pixels as a PNG file (ISO/IEC 15948): one IDAT, no filter."""
    height, width = picture.shape[:2]
    rows = np.hstack([np.zeros((height, 1), dtype=np.uint8), picture.reshape(height, -1)])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + chunk(b"IEND", b"")
