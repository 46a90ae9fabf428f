"""The folder of a site's keys: authority, register, one sub-folder a holder, one bundle a robot.

``ca.pem`` and ``NAME/certificate.pem``, ``NAME/private.key`` are what a process of NAME needs. The authority's key
(``authority/private.key``) is needed by ``keys`` alone: it may live on a stick. ``register.json`` is what the router
makes its rules from. Private keys are readable by their owner only, from the moment their file exists.
"""

import io
import os
import tarfile
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path

import msgspec

from groundstation import certificates
from groundstation.certificates import Pair
from groundstation.register import Register

CERTIFICATE, PRIVATE_KEY, AUTHORITY, REGISTER = "certificate.pem", "private.key", "ca.pem", "register.json"


class KeysError(ValueError):
    """The folder does not allow it; the text says why and what to do."""


class Keyring:
    """A folder of keys.

    :param authority: where the authority's private key lies; a sub-folder of ``folder`` by default.
    """

    def __init__(self, folder: Path, authority: Path | None = None) -> None:
        self.folder = folder
        self._authority = authority or folder / "authority"

    def register(self) -> Register:
        """:raises KeysError: there is none, or it cannot be read."""
        path = self.folder / REGISTER
        try:
            return msgspec.json.decode(path.read_bytes(), type=Register)
        except OSError as error:
            raise KeysError(f"{path}: {error.strerror}; begin with `ahdc-groundstation keys init`") from None
        except msgspec.DecodeError as error:
            raise KeysError(
                f"{path}: {error}; restore it from a copy, or begin anew with keys init --replace"
            ) from None

    def found(self, site: str, now: datetime, replace: bool = False) -> None:
        """Make the site's authority and an empty register.

        :raises KeysError: there is an authority already and it is not to be replaced.
        """
        key = self._authority / PRIVATE_KEY
        if not replace and (key.exists() or (self.folder / AUTHORITY).exists()):
            raise KeysError(
                f"{self.folder} has an authority; --replace makes another, after which every certificate is void"
            )
        pair = certificates.make_authority(site, now)
        _write(key, pair.private_key, 0o600)
        _write(self.folder / AUTHORITY, pair.certificate, 0o644)
        self._note(Register(site))

    def issue(self, name: str, days: float, now: datetime, servers: Iterable[str] = (), replace: bool = False) -> str:
        """A new certificate and key for a holder; returns its common name.

        :param servers: addresses of the router; only the router's certificate has any.
        :raises KeysError: no authority, or the holder has a certificate that is not to be replaced.
        """
        register = self.register()
        valid = register.current(name)
        if valid is not None and valid.not_after > now and not replace:
            raise KeysError(f"{name} has a certificate until {valid.not_after:%Y-%m-%d}; --replace makes another")
        common_name = register.next_common_name(name)
        try:
            authority = Pair((self.folder / AUTHORITY).read_bytes(), (self._authority / PRIVATE_KEY).read_bytes())
            pair = certificates.sign(authority, common_name, now + timedelta(days=days), now, servers)
        except OSError as error:
            raise KeysError(f"{error.filename}: {error.strerror}; name the authority's folder by --authority") from None
        except ValueError as error:
            raise KeysError(f"{self._authority / PRIVATE_KEY}: {error}") from None
        _write(self.folder / name / PRIVATE_KEY, pair.private_key, 0o600)
        _write(self.folder / name / CERTIFICATE, pair.certificate, 0o644)
        self._note(register.issued(name, certificates.about(pair.certificate)))
        return common_name

    def revoke(self, name: str) -> None:
        """:raises KeysError: no such holder, or it has no certificate that counts."""
        register = self.register()
        if register.current(name) is None:
            known = ", ".join(register.common_names()) or "nobody"
            raise KeysError(f"{name} has no certificate to revoke; certificates that count: {known}")
        self._note(register.revoked(name))

    def bundle(self, name: str) -> Path:
        """A tar file with what a robot needs of this folder, to be unpacked beside its arena file."""
        held = io.BytesIO()
        with tarfile.open(fileobj=held, mode="w") as tar:
            for part in (AUTHORITY, f"{name}/{CERTIFICATE}", f"{name}/{PRIVATE_KEY}"):
                content = (self.folder / part).read_bytes()
                entry = tarfile.TarInfo(f"{self.folder.name}/{part}")
                entry.size, entry.mode = len(content), 0o600 if part.endswith(PRIVATE_KEY) else 0o644
                tar.addfile(entry, io.BytesIO(content))
        path = self.folder / f"{name}.tar"
        _write(path, held.getvalue(), 0o600)
        return path

    def held(self) -> dict[str, bytes]:
        """Certificates in this folder by holder: all on the station's computer, its own on a robot's."""
        return {path.parent.name: path.read_bytes() for path in sorted(self.folder.glob(f"*/{CERTIFICATE}"))}

    def too_open(self) -> list[str]:
        """Private keys that others than their owner can read, relative to the folder."""
        found = [*self.folder.glob(f"*/{PRIVATE_KEY}"), *self.folder.glob("*.tar")]
        return sorted(str(path.relative_to(self.folder)) for path in found if path.stat().st_mode & 0o077)

    def _note(self, register: Register) -> None:
        content = msgspec.json.format(msgspec.json.encode(register), indent=1)
        _write(self.folder / REGISTER, content + b"\n", 0o644)


def _write(path: Path, content: bytes, mode: int) -> None:
    """Whole or not at all, and never readable by others for a moment."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)
