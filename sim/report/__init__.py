"""The report of a proof: one HTML file to read, print and sign."""

from sim.report.found import where
from sim.report.page import html

__all__ = ["html", "where"]
