"""Parts that are hard for one build direction: closed meshes in mm, made by booleans, each with its recipe."""

from tests.parts.catalogue import PARTS, Sample

__all__ = ["PARTS", "Sample"]
