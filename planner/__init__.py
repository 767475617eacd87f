"""From mesh and recipe to toolpaths and G-code."""
