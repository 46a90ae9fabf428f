"""A site's own certificate authority and the short-lived certificates it signs. Pure but for the dice.

EC keys on P-256. A robot's certificate is for client authentication only: with server authentication as well and a
fitting name, a robot could pose as the router. Only the router's is for servers, and only it carries addresses.
"""

import ipaddress
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

AUTHORITY_DAYS = 3650
EARLY = timedelta(days=1)
"""Certificates begin this much before they are signed: a robot's clock may be wrong until it has heard the site's."""


class Pair(NamedTuple):
    """A certificate and its private key, PEM."""

    certificate: bytes
    private_key: bytes


class About(NamedTuple):
    """What a certificate says, for people and for the register."""

    common_name: str
    serial: str
    not_before: datetime
    not_after: datetime
    server: bool
    fingerprint: str
    """SHA-256, hexadecimal."""


def make_authority(site: str, now: datetime) -> Pair:
    """The certificate that vouches for all others of a site."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"ahdc {site}")])
    usage = _usage(key_cert_sign=True, crl_sign=True)
    certificate = (
        _builder(name, name, key.public_key(), now, now + timedelta(days=AUTHORITY_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    return Pair(_pem(certificate), _private_pem(key))


def sign(authority: Pair, common_name: str, not_after: datetime, now: datetime, servers: Iterable[str] = ()) -> Pair:
    """A certificate with a fresh key; for a client, or for a server at the addresses and names ``servers``.

    :raises ValueError: the authority's files do not belong together, or are no keys.
    """
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    signer = serialization.load_pem_private_key(authority.private_key, None)
    if not isinstance(signer, ec.EllipticCurvePrivateKey) or signer.public_key() != issuer.public_key():
        raise ValueError("the authority's private key does not belong to its certificate")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
    addresses = [_alternative(entry) for entry in servers]
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if addresses else ExtendedKeyUsageOID.CLIENT_AUTH
    last = min(not_after, issuer.not_valid_after_utc)
    builder = (
        _builder(name, issuer.subject, key.public_key(), now, last)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False)
    )
    if addresses:
        builder = builder.add_extension(x509.SubjectAlternativeName(addresses), critical=False)
    return Pair(_pem(builder.sign(signer, hashes.SHA256())), _private_pem(key))


def about(certificate: bytes) -> About:
    """What a PEM certificate says.

    :raises ValueError: not a certificate.
    """
    found = x509.load_pem_x509_certificate(certificate)
    names = found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    try:
        purposes = list(found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    except x509.ExtensionNotFound:
        purposes = []
    return About(
        common_name=str(names[0].value) if names else "",
        serial=f"{found.serial_number:x}",
        not_before=found.not_valid_before_utc,
        not_after=found.not_valid_after_utc,
        server=ExtendedKeyUsageOID.SERVER_AUTH in purposes,
        fingerprint=found.fingerprint(hashes.SHA256()).hex(),
    )


def belongs(certificate: bytes, private_key: bytes) -> bool:
    """Whether the private key is the certificate's."""
    try:
        key = serialization.load_pem_private_key(private_key, None)
        return bool(key.public_key() == x509.load_pem_x509_certificate(certificate).public_key())
    except (ValueError, TypeError):
        return False


def _builder(
    subject: x509.Name, issuer: x509.Name, public: ec.EllipticCurvePublicKey, now: datetime, until: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLY)
        .not_valid_after(until)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
    )


def _usage(digital_signature: bool = False, key_cert_sign: bool = False, crl_sign: bool = False) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature,
        key_cert_sign=key_cert_sign,
        crl_sign=crl_sign,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _alternative(server: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(server))
    except ValueError:
        return x509.DNSName(server)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _private_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
