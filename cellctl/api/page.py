"""The operator's page: the files that were built, at `/`, and at `/cells/NAME/` as another cell's."""

from __future__ import annotations

import base64
import hashlib
import re
from html import escape
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse, Response
from starlette.exceptions import HTTPException

from cellctl.api.problems import ApiError

DIST = Path(__file__).resolve().parent.parent / "console" / "dist"
INLINE_SCRIPT = re.compile(r"<script(?![^>]*\bsrc\s*=)([^>]*)>(.*?)</script>", re.DOTALL | re.IGNORECASE)
DATA_BLOCK = re.compile(r"type\s*=\s*[\"']?application/(ld\+)?json", re.IGNORECASE)
IMMUTABLE = "public, max-age=31536000, immutable"
MEDIA_TYPES = {
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".json": "application/json",
    ".webmanifest": "application/manifest+json",
    ".html": "text/html; charset=utf-8",
    ".wasm": "application/wasm",
    ".map": "application/json",
}


def inline_script_hashes(html: str) -> list[str]:
    """`sha256-...` of each inline script, for the Content-Security-Policy."""
    bodies = (body for attributes, body in INLINE_SCRIPT.findall(html) if not DATA_BLOCK.search(attributes))
    return ["sha256-" + base64.b64encode(hashlib.sha256(body.encode()).digest()).decode() for body in bodies]


class Page:
    """The built files of one folder; looked at again when index.html changes."""

    def __init__(self, folder: Path = DIST) -> None:
        self.folder = folder
        self._stamp: tuple[int, int] | None = None
        self._hashes: list[str] = []
        self.router = APIRouter(include_in_schema=False)
        self.router.add_api_route("/", self.index, methods=["GET", "HEAD"], response_class=FileResponse)
        self.router.add_api_route("/{path:path}", self.file, methods=["GET", "HEAD"], response_class=FileResponse)

    def script_hashes(self) -> list[str]:
        """Hashes of the inline scripts of index.html, empty if it is not built."""
        try:
            stat = (self.folder / "index.html").stat()
        except OSError:
            return []
        stamp = (stat.st_mtime_ns, stat.st_size)
        if stamp != self._stamp:
            self._hashes = inline_script_hashes((self.folder / "index.html").read_text(encoding="utf-8"))
            self._stamp = stamp
        return self._hashes

    def index(self) -> Response:
        """The page itself."""
        path = self.folder / "index.html"
        if not path.is_file():
            raise ApiError(
                404,
                "The console is not built",
                "there is no page here",
                "run `make console`; the REST interface works without it",
            )
        return FileResponse(path, media_type=MEDIA_TYPES[".html"], headers={"Cache-Control": "no-cache"})

    def of_cell(self, stop_url: str) -> Response:
        """The page of another cell. stop_url : of its STOP listener, which the page's own script reads before it has asked for anything"""
        answer = self.index()
        assert isinstance(answer, FileResponse)
        html = Path(answer.path).read_text(encoding="utf-8")
        told = f'<meta name="stop-url" content="{escape(stop_url)}">'
        return HTMLResponse(html.replace("<head>", f"<head>{told}", 1), headers={"Cache-Control": "no-cache"})

    def file(self, path: str) -> Response:
        """A file of the page. A path that leads out of the folder is not found."""
        root = self.folder.resolve()
        if path.startswith("api/"):
            raise HTTPException(404)  # the interface says what there is, and how it may be asked
        target = (root / path).resolve() if "\0" not in path else None
        if target is None or not target.is_relative_to(root) or not target.is_file() or target.name.startswith("."):
            raise ApiError(
                404, "Not found", "there is nothing at this path", "the interface is described at /openapi.json"
            )
        cache = IMMUTABLE if "assets" in target.relative_to(root).parts else "no-cache"
        return FileResponse(
            target,
            media_type=MEDIA_TYPES.get(target.suffix, "application/octet-stream"),
            headers={"Cache-Control": cache},
        )
