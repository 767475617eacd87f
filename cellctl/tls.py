"""TLS by file: a certificate and its key, checked before anything listens with them."""

from __future__ import annotations

import ssl
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509

SOON_DAYS = 21  # a certificate that ends within this time is warned of


class TlsError(Exception):
    """A certificate or key that cannot be used. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def check(cert: Path | None, key: Path | None, now: datetime | None = None) -> str:
    """Whether a service can listen with these files; a line of warning, "" if there is nothing to warn of. Raises TlsError."""
    if cert is None or key is None:
        given, other = ("--tls-cert", "--tls-key") if key is None else ("--tls-key", "--tls-cert")
        raise TlsError(f"{given} is given without {other}", "TLS needs both: a certificate and its key, as PEM files")
    found = certificate(cert)
    at = now or datetime.now(UTC)
    renew = "renew it, or name another one with --tls-cert"
    if at >= found.not_valid_after_utc:
        raise TlsError(f"{cert}: the certificate has expired on {found.not_valid_after_utc:%Y-%m-%d %H:%M} UTC", renew)
    if at < found.not_valid_before_utc:
        raise TlsError(f"{cert}: the certificate is valid from {found.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on", "look at this machine's clock")
    server_context(cert, key)
    left = found.not_valid_after_utc - at
    return f"{cert}: the certificate expires in {left.days} days" if left.days < SOON_DAYS else ""


def certificate(cert: Path) -> x509.Certificate:
    """The first certificate in a file: the service's own. Raises TlsError."""
    try:
        return x509.load_pem_x509_certificates(_bytes(cert, "certificate"))[0]
    except ValueError:
        raise TlsError(f"{cert}: holds no certificate", "it must be a PEM file: -----BEGIN CERTIFICATE-----") from None


def _bytes(path: Path, what: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise TlsError(f"{path}: the {what} cannot be read: {error.strerror}", "look at its name and permissions") from None


def server_context(cert: Path, key: Path) -> ssl.SSLContext:
    """TLS 1.2 or newer with these files. Raises TlsError if the key is none, wants a passphrase, or is another one's."""
    if b"PRIVATE KEY-----" not in _bytes(key, "key"):
        raise TlsError(f"{key}: holds no private key", "it must be a PEM file: -----BEGIN PRIVATE KEY-----")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2

    def no_passphrase() -> str:
        raise TlsError(f"{key}: the key wants a passphrase", "give the service a key without one that only its user can read")

    try:
        context.load_cert_chain(cert, key, no_passphrase)
    except ssl.SSLError as error:
        if "MISMATCH" in (error.reason or ""):
            raise TlsError(f"{key} is not the key of the certificate in {cert}", "name the two files that belong together") from None
        raise TlsError(f"{cert} and {key} cannot be used: {error.reason or error}", "make them anew as PEM files") from None
    return context


def pinned_context(cert: Path) -> ssl.SSLContext:
    """For a client on this machine: trusts this very certificate, under whatever name it is reached. Raises TlsError."""
    certificate(cert)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    context.load_verify_locations(cert)
    return context


def names_of(cert: Path) -> frozenset[str]:
    """The host names that a certificate is for, small letters, `*.` as it stands there. Raises TlsError."""
    try:
        names = certificate(cert).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return frozenset()
    return frozenset(name.lower() for name in names.get_values_for_type(x509.DNSName))
