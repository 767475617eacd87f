"""What one host of a house vouches for when it passes a request on to another: whom it came from, in words that only hosts can sign.

The header reads `WORD.MAC`: the word as JSON, and HMAC-SHA256 of that text under the sender's secret, both in base64url.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac

import msgspec

HEADER = "cell-forwarded"
HEADER_LIMIT = 4096  # characters: an address, a host, a path with its query, and room
MAX_AGE_S = 10.0  # between two hosts' clocks and on the way


class Word(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One request that is passed on.

    at : of the house, Unix s   once : chance, so that a word counts once   sender, cell : whose host passes it on to whose
    address : of the person   host, scheme : as the person's page calls the sender's host   target : path and query, as sent
    stop_url : where the sender's pages reach STOP of `cell`
    """

    at: float
    once: str
    sender: str
    cell: str
    address: str
    host: str
    scheme: str
    method: str
    target: str
    stop_url: str


_decoder = msgspec.json.Decoder(Word)


def signed(word: Word, secret: bytes) -> str:
    """The header's value."""
    text = _text(msgspec.json.encode(word))
    return f"{text}.{_text(_mac(text, secret))}"


def claimed(header: str) -> Word | None:
    """The word that a header says it is, whoever wrote it; None if it is none."""
    text, dot, _ = header.partition(".")
    if not dot or len(header) > HEADER_LIMIT or not header.isascii():
        return None
    try:
        return _decoder.decode(_bytes(text))
    except (binascii.Error, ValueError, msgspec.MsgspecError):
        return None


def is_signed(header: str, secret: bytes | None) -> bool:
    """Whether the owner of this secret wrote the header; nobody did where there is no secret."""
    text, _, mac = header.partition(".")
    try:
        return secret is not None and hmac.compare_digest(_bytes(mac), _mac(text, secret))
    except (binascii.Error, ValueError):
        return False


def why_not(word: Word, cell: str, method: str, target: str, now: float) -> str:
    """Why a host does not take a word that is signed, in one line; empty if it does. now : of the house, Unix s"""
    if word.method != method or word.target != target:
        return f"the word of {word.sender}'s host is of another request"
    if abs(now - word.at) > MAX_AGE_S:
        return f"the word of {word.sender}'s host is {now - word.at:.0f} s old, {MAX_AGE_S:.0f} s are allowed"
    return "" if word.cell == cell else f"this is the host of {cell}, not of {word.cell}"


def _mac(text: str, secret: bytes) -> bytes:
    return hmac.digest(secret, text.encode(), hashlib.sha256)


def _text(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


def _bytes(text: str) -> bytes:
    return base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
