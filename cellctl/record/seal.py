"""The seal of a record: the hashes of its files in one manifest, signed with the service's own Ed25519 key (RFC 8032).

The private key lies in the store's folder, readable by its owner alone. Whoever has the public key, or its fingerprint on paper,
can tell whether a file of a record was changed, taken away or added. A seal says which service wrote the record and that nothing
was changed since; it does not say what time it was, nor does it bind somebody who can read the private key.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)

from cellctl.record.layout import MANIFEST, PUBLIC_KEY, SEALING, SIGNATURE
from cellctl.store.blobs import sha256_of

KEY_FILE = "record.key"


class SealError(Exception):
    """A record that is not what was sealed. `message` is one line; `hint` says what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


@dataclass(frozen=True)
class Seal:
    """A key that seals."""

    private: Ed25519PrivateKey

    @property
    def public_pem(self) -> bytes:
        """The key that verifies, as PEM."""
        return self.private.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)

    @property
    def fingerprint(self) -> str:
        """SHA-256 (hex) of the public key."""
        return fingerprint_of(self.public_pem)

    def close(self, folder: Path, about: dict[str, Any]) -> str:
        """Write manifest, signature and public key into a folder whose files are complete; the manifest's SHA-256 (hex)."""
        files = {path.name: sha256_of(path) for path in sorted(folder.iterdir()) if path.name not in SEALING}
        manifest = json.dumps({**about, "key": self.fingerprint, "files": files}, indent=1, sort_keys=True, ensure_ascii=False).encode()
        (folder / MANIFEST).write_bytes(manifest)
        (folder / SIGNATURE).write_bytes(self.private.sign(manifest))
        (folder / PUBLIC_KEY).write_bytes(self.public_pem)
        return hashlib.sha256(manifest).hexdigest()


def open_seal(store: Path) -> Seal:
    """The store's key, made at its first use. Raises SealError if the file holds no key or others may read it."""
    path = store / KEY_FILE
    if not path.exists():
        made = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        descriptor, beside = tempfile.mkstemp(dir=store, prefix=KEY_FILE)  # readable by its owner alone
        with os.fdopen(descriptor, "wb") as file:
            file.write(made)
            file.flush()
            os.fsync(file.fileno())
        with suppress(FileExistsError):  # another process was first
            os.link(beside, path)
        os.unlink(beside)
    if path.stat().st_mode & 0o077:
        raise SealError(f"{path}: others may read the key that seals records", f"chmod 600 {path}, and think about who may have copied it")
    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except ValueError as error:
        raise SealError(f"{path}: holds no key: {error}", "restore it from a backup; a new key cannot vouch for old records") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise SealError(f"{path}: holds another kind of key", "restore it from a backup")
    return Seal(key)


def fingerprint_of(pem: bytes) -> str:
    """SHA-256 (hex) of a public key in its DER form. Raises SealError if it is none."""
    return hashlib.sha256(_public(pem).public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)).hexdigest()


def _public(pem: bytes) -> Ed25519PublicKey:
    try:
        key = load_pem_public_key(pem)
    except ValueError:
        raise SealError(f"{PUBLIC_KEY}: holds no key", "take the public key of the service: GET /api/v1/record-key") from None
    if not isinstance(key, Ed25519PublicKey):
        raise SealError(f"{PUBLIC_KEY}: holds another kind of key than Ed25519", "take the public key of the service: GET /api/v1/record-key")
    return key


def verify(folder: Path, public_pem: bytes | None = None) -> dict[str, Any]:
    """The manifest of a record of which nothing was changed, taken away or added.

    public_pem : the service's key; without it the key beside the record is taken, whose fingerprint (`key` of the manifest) has then to
    be compared with the service's by whoever asks. Raises SealError that names what is wrong.
    """
    try:
        manifest, signature = (folder / MANIFEST).read_bytes(), (folder / SIGNATURE).read_bytes()
        pem = (folder / PUBLIC_KEY).read_bytes() if public_pem is None else public_pem
    except OSError as error:
        raise SealError(f"{error.filename}: {error.strerror}", f"a sealed record holds {', '.join(sorted(SEALING))}") from None
    try:
        _public(pem).verify(signature, manifest)
    except InvalidSignature:
        raise SealError(f"{folder / MANIFEST}: its signature does not fit", "it was changed, or sealed by another service") from None
    document: dict[str, Any] = json.loads(manifest)
    if document["key"] != fingerprint_of(pem):
        raise SealError(f"{folder / MANIFEST}: names another key than the one that signed it", "it was sealed by another service")
    there = {path.name for path in folder.iterdir()} - SEALING
    for name, sha256 in document["files"].items():
        if name not in there:
            raise SealError(f"{folder / name}: is missing", "take the whole record from the service again")
        if sha256_of(folder / name) != sha256:
            raise SealError(f"{folder / name}: was changed after it was sealed", "take the record from the service again")
    added = sorted(there - document["files"].keys())
    if added:
        raise SealError(f"{folder / added[0]}: was not there when the record was sealed", "keep other files elsewhere")
    return document
