"""A plan for people: `text`, `as_json`, `png` and `html`; all return what is to be written and open no file."""

from planner.show.page import html
from planner.show.picture import png
from planner.show.summary import as_json, text

__all__ = ["as_json", "html", "png", "text"]
