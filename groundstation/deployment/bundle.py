"""Wheels for robots: the field kit's own and the installer's from what runs here, the others from the lock file."""

import base64
import csv
import hashlib
import importlib.util
import io
import os
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import Distribution, PackageNotFoundError, distribution, requires
from pathlib import Path

from groundstation.deployment.pins import DISTRIBUTION, Pin, PinError, platforms

ROOMS = ("contract", "onboard", "drivers", "mocap_bridge", "groundstation")
EPOCH = (1980, 1, 1, 0, 0, 0)
LOCK = "requirements.lock"


def cache() -> Path:
    """Where wheels are kept between deployments."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "ahdc-fieldkit" / "wheels"


def lock_text() -> str:
    """The lock file: beside the packages in a checkout, in the package where installed.

    :raises PinError: there is none.
    """
    here = Path(__file__).resolve().parents[1]
    for path in (here.parent / LOCK, here / "deployment" / LOCK):
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise PinError(f"no {LOCK} beside the packages; deploy from a checkout, or install the wheel anew")


def needs(names: list[str]) -> dict[str, list[str]]:
    """Requirements of packages, as their installed metadata says; what is not installed is left out."""
    found: dict[str, list[str]] = {}
    for name in names:
        try:
            found[name] = requires(name) or []
        except PackageNotFoundError:
            continue
    return found


def present(pins: list[Pin], folder: Path) -> dict[str, Path]:
    """Package name to the wheel in ``folder`` whose hash the lock file has."""
    wheels = {sha256(path): path for path in sorted(folder.glob("*.whl"))} if folder.is_dir() else {}
    return {pin.name: wheels[digest] for pin in pins for digest in pin.hashes if digest in wheels}


def own_version() -> str:
    """Version of the field kit that runs here.

    :raises PinError: it is not installed.
    """
    try:
        return distribution(DISTRIBUTION).version
    except PackageNotFoundError:
        raise PinError("the field kit is not installed here; ./kit exec, or pip install -e .") from None


def fetch(
    pins: list[Pin], python: str, machine: str, glibc: tuple[int, ...], folder: Path, source: Path | None
) -> None:
    """The pins' wheels into ``folder``, hashes checked by pip; from ``source`` alone where it is given.

    :raises PinError: with pip's own words.
    """
    folder.mkdir(parents=True, exist_ok=True)
    listing = folder.with_suffix(".txt")
    listing.write_text("".join(f"{pin.line()}\n" for pin in pins), encoding="utf-8")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-input", "--disable-pip-version-check"]
    command += ["--require-hashes", "--no-deps", "--only-binary=:all:", f"--python-version={python}"]
    command += ["--implementation=cp", f"--abi=cp{python.replace('.', '')}", "--abi=abi3", "--abi=none"]
    command += [f"--platform={tag}" for tag in platforms(machine, glibc)]
    command += ["--no-index", f"--find-links={source}"] if source else [f"--find-links={folder}"]
    command += [f"--dest={folder}", f"--requirement={listing}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PinError(f"wheels for {machine}, Python {python}: {' | '.join(done.stderr.strip().splitlines()[-3:])}")


def own_wheel(folder: Path) -> Path:
    """A wheel of the field kit as it runs here, a checkout's changes included; the same bytes from the same files."""
    files: dict[str, bytes] = {}
    for room in ROOMS:
        found = importlib.util.find_spec(room)
        assert found is not None
        assert found.submodule_search_locations
        top = Path(next(iter(found.submodule_search_locations)))
        for path in sorted(top.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".pyc":
                files[f"{room}/{path.relative_to(top).as_posix()}"] = path.read_bytes()
    files[f"groundstation/deployment/{LOCK}"] = lock_text().encode()
    own_version()
    return pack(distribution(DISTRIBUTION), files, folder)


def pip_wheel(folder: Path) -> Path:
    """A wheel of the pip that runs here, for robots that have none."""
    pip = distribution("pip")
    files = {}
    for entry in pip.files or []:
        path = Path(str(entry.locate()))
        if entry.parts[0] == "pip" and path.suffix != ".pyc" and path.is_file():
            files[entry.as_posix()] = path.read_bytes()
    if not files:
        raise PinError("pip is not installed here; python -m ensurepip")
    return pack(pip, files, folder)


def pack(source: Distribution, files: dict[str, bytes], folder: Path) -> Path:
    """A pure wheel with these files and the metadata of an installed distribution."""
    name = source.metadata["Name"].replace("-", "_")
    info = f"{name}-{source.version}.dist-info"
    whole = dict(files)
    whole[f"{info}/METADATA"] = (source.read_text("METADATA") or "").encode()
    whole[f"{info}/WHEEL"] = (
        b"Wheel-Version: 1.0\nGenerator: ahdc-groundstation\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    )
    if scripts := source.read_text("entry_points.txt"):
        whole[f"{info}/entry_points.txt"] = scripts.encode()
    record = io.StringIO()
    rows = csv.writer(record, lineterminator="\n")
    for path, data in sorted(whole.items()):
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        rows.writerow([path, f"sha256={digest}", len(data)])
    rows.writerow([f"{info}/RECORD", "", ""])
    whole[f"{info}/RECORD"] = record.getvalue().encode()
    folder.mkdir(parents=True, exist_ok=True)
    wheel = folder / f"{name}-{source.version}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in sorted(whole.items()):
            archive.writestr(zipfile.ZipInfo(path, EPOCH), data, zipfile.ZIP_DEFLATED)
    return wheel


def sha256(path: Path) -> str:
    """Of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def fresh(folder: Path) -> Path:
    """An empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder
