"""Certificates, the folder they lie in, the verb that makes them, and the rules made from them."""

import stat
import subprocess
import sys
import tarfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID

from contract.arena import Arena, load
from contract.exposure import ROLES
from contract.keys import Keys
from groundstation import access, certificates, cli, rig
from groundstation.keyring import Keyring, KeysError
from groundstation.register import Register, lifetime

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    text = rig.find_arena("bench2").read_text()
    path.write_text(text.replace('"tcp/127.0.0.1:7447"', '"quic/192.168.7.1:7447"\nkeys = "keys"'))
    return path


def keys(file: Path, *words: str) -> int:
    return cli.main(["keys", *words, "--arena", str(file)])


@pytest.fixture
def issued(file: Path) -> Path:
    assert keys(file, "init") == keys(file, "issue") == 0
    return file


def certificate(file: Path, name: str) -> x509.Certificate:
    return x509.load_pem_x509_certificate((file.parent / "keys" / name / "certificate.pem").read_bytes())


def test_only_the_router_is_a_server_and_only_it_has_addresses(issued: Path) -> None:
    authority = x509.load_pem_x509_certificate((issued.parent / "keys" / "ca.pem").read_bytes())
    for name in (*ROLES, "r06", "r08"):
        found = certificate(issued, name)
        found.verify_directly_issued_by(authority)
        purposes = list(found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
        server = name == "router"
        assert purposes == [ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH]
        assert found.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)[0].value == name
        assert not found.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        assert found.not_valid_after_utc - datetime.now(UTC) < timedelta(days=30)
        names = [e.value for e in found.extensions if isinstance(e.value, x509.SubjectAlternativeName)]
        assert bool(names) == server
    addresses = certificate(issued, "router").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert "192.168.7.1" in map(str, addresses.get_values_for_type(x509.IPAddress))


def test_private_keys_are_their_owners_alone_and_the_bundle_holds_what_one_robot_needs(issued: Path) -> None:
    folder = issued.parent / "keys"
    for path in (*folder.glob("*/private.key"), *folder.glob("*.tar")):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with tarfile.open(folder / "r06.tar") as tar:
        names = {entry.name: entry.mode for entry in tar.getmembers()}
    assert names == {"keys/ca.pem": 0o644, "keys/r06/certificate.pem": 0o644, "keys/r06/private.key": 0o600}
    assert not Keyring(folder).too_open()
    (folder / "r06" / "private.key").chmod(0o640)
    assert Keyring(folder).too_open() == ["r06/private.key"]
    assert keys(issued, "list") == 1


def test_nothing_is_overwritten_unless_asked(issued: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = certificate(issued, "r06").serial_number
    assert keys(issued, "init") == 1
    assert keys(issued, "issue", "r06") == 1
    assert "--replace makes another" in capsys.readouterr().err
    assert keys(issued, "issue") == 0
    assert certificate(issued, "r06").serial_number == before
    assert keys(issued, "issue", "r06", "--replace") == 0
    assert certificate(issued, "r06").serial_number != before
    assert Keyring(issued.parent / "keys").register().common_names()["r06"] == "r06"


def test_the_next_name_of_a_revoked_robot_is_another(issued: Path, capsys: pytest.CaptureFixture[str]) -> None:
    keyring = Keyring(issued.parent / "keys")
    assert keys(issued, "revoke", "r06") == 0
    assert "r06" not in keyring.register().common_names()
    assert keys(issued, "revoke", "r06") == 1
    assert "has no certificate to revoke" in capsys.readouterr().err
    assert keys(issued, "issue") == 0
    assert "r06" not in keyring.register().common_names(), "only a name that is given brings a revoked one back"
    assert keys(issued, "issue", "r06") == 0
    assert keyring.register().common_names()["r06"] == "r06.2"
    assert keys(issued, "revoke", "r06") == keys(issued, "issue", "r06") == 0
    assert keyring.register().common_names()["r06"] == "r06.3"
    capsys.readouterr()
    assert keys(issued, "list") == 0
    assert "r06        r06.3" in capsys.readouterr().out


def test_nothing_secret_is_printed(issued: Path, capfd: pytest.CaptureFixture[str]) -> None:
    keys(issued, "issue", "--replace")
    keys(issued, "list")
    said = "".join(capfd.readouterr())
    secrets = [path.read_text().splitlines()[1] for path in (issued.parent / "keys").glob("*/private.key")]
    assert secrets
    assert not any(secret in said for secret in secrets)
    assert "PRIVATE" not in said


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["issue"], 1, "begin with `ahdc-groundstation keys init`"),
        (["issue", "r07"], 2, "no robot of bench2"),
        (["revoke"], 2, "revoke whom?"),
        (["issue", "--days", "9999"], 2, "up to 825"),
    ],
)
def test_bad_requests_say_what_to_do(
    file: Path, words: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert keys(file, *words) == code
    assert said in capsys.readouterr().err


def test_without_link_keys_there_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert keys(rig.find_arena("bench2"), "init") == 2
    assert "link.keys" in capsys.readouterr().err


def test_an_authority_kept_elsewhere_is_named(issued: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (issued.parent / "keys" / "authority").rename(tmp_path / "stick")
    assert keys(issued, "issue", "r06", "--replace") == 1
    assert "--authority" in capsys.readouterr().err
    assert keys(issued, "issue", "r06", "--replace", "--authority", str(tmp_path / "stick")) == 0


def test_a_foreign_authority_signs_nothing(issued: Path) -> None:
    foreign = certificates.make_authority("elsewhere", NOW)
    (issued.parent / "keys" / "authority" / "private.key").write_bytes(foreign.private_key)
    with pytest.raises(KeysError, match="does not belong"):
        Keyring(issued.parent / "keys").issue("r06", 1.0, NOW, replace=True)


def test_a_register_that_cannot_be_read_is_named(issued: Path) -> None:
    (issued.parent / "keys" / "register.json").write_text("{")
    with pytest.raises(KeysError, match=r"register\.json"):
        Keyring(issued.parent / "keys").register()


def test_a_certificate_says_what_it_is() -> None:
    authority = certificates.make_authority("lab", NOW)
    pair = certificates.sign(authority, "r06", NOW + timedelta(days=3), NOW)
    found = certificates.about(pair.certificate)
    assert (found.common_name, found.server, found.not_after) == ("r06", False, NOW + timedelta(days=3))
    assert found.not_before == NOW - certificates.EARLY
    assert certificates.belongs(pair.certificate, pair.private_key)
    assert not certificates.belongs(pair.certificate, authority.private_key)
    late = certificates.sign(authority, "r06", NOW + timedelta(days=9999), NOW)
    assert certificates.about(late.certificate).not_after == certificates.about(authority.certificate).not_after
    key = x509.load_pem_x509_certificate(pair.certificate).public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)


@pytest.mark.parametrize(
    ("left", "words", "well"),
    [
        (timedelta(days=30), "ends in 30 days", True),
        (timedelta(days=1, hours=3), "ends in 1 day", False),
        (timedelta(hours=5), "ends in 5 h", False),
        (timedelta(minutes=-12), "expired 12 min ago", False),
    ],
)
def test_what_is_left_of_a_certificate_in_words(left: timedelta, words: str, well: bool) -> None:
    assert lifetime(NOW + left, NOW) == (words, well)


# --- the rules ----------------------------------------------------------------------------------


def covers(expressions: tuple[str, ...], key: str) -> bool:
    """Whether one of the key expressions takes in a key: ``*`` is a chunk, ``**`` any number."""

    def fits(pattern: list[str], chunks: list[str]) -> bool:
        if not pattern:
            return not chunks
        if pattern[0] == "**":
            return any(fits(pattern[1:], chunks[k:]) for k in range(len(chunks) + 1))
        return bool(chunks) and pattern[0] in ("*", chunks[0]) and fits(pattern[1:], chunks[1:])

    return any(fits(expression.split("/"), key.split("/")) for expression in expressions)


ARENA: Arena = load(rig.find_arena("experiment2"))
KEYS = Keys(ARENA.arena.name)
OF_ROBOTS = {name: [getattr(KEYS, kind)(name) for kind in ("state", "report", "steps", "feedback", "inputs", "log")]
             for name in ARENA.robots}  # fmt: skip
OTHER = [
    KEYS.mocap_frame, KEYS.mocap_health, KEYS.external, KEYS.virtual, KEYS.heartbeat, KEYS.targets, KEYS.status,
    KEYS.seed, KEYS.order, KEYS.stop, KEYS.log("station"), KEYS.log("mocap_bridge"), *map(KEYS.motor, ARENA.robots),
]  # fmt: skip
EVERY = [*OTHER, *(key for keys_of in OF_ROBOTS.values() for key in keys_of)]
SAYS = {
    "station": {
        KEYS.heartbeat, KEYS.targets, KEYS.status, KEYS.seed, KEYS.order, KEYS.stop, KEYS.log("station"),
        KEYS.log("mocap_bridge"), *map(KEYS.log, ARENA.robots),
    },
    "operator": {KEYS.seed, KEYS.order, KEYS.stop},
    "bridge": {KEYS.mocap_frame, KEYS.mocap_health, KEYS.log("mocap_bridge")},
    "external": {KEYS.external},
    "mock": {KEYS.virtual, *map(KEYS.motor, ARENA.robots)},
    **{name: set(own) for name, own in OF_ROBOTS.items()},
}  # fmt: skip


@pytest.mark.parametrize("name", SAYS)
def test_everybody_says_its_own_and_nothing_else(name: str) -> None:
    leave = access.leaves(ARENA)[name]
    assert {key for key in EVERY if covers(leave.says, key)} == SAYS[name]


@pytest.mark.parametrize("name", ARENA.robots)
def test_a_robot_hears_what_it_needs_and_nothing_else(name: str) -> None:
    needs = {KEYS.stop, KEYS.heartbeat, KEYS.mocap_frame, KEYS.targets, *map(KEYS.state, ARENA.robots)}
    assert {key for key in EVERY if covers(access.leaves(ARENA)[name].hears, key)} == needs


def test_what_a_robot_subscribes_to_it_may_hear() -> None:
    from onboard.runtime import subscriptions

    for key in (*subscriptions(ARENA), *map(KEYS.state, ARENA.robots)):
        assert all(covers(access.leaves(ARENA)[name].hears, key) for name in ARENA.robots)


def test_virtual_bodies_hear_the_wheels_they_roll_on_and_reach_the_bridge() -> None:
    robots = {
        name: msgspec.structs.replace(robot, emulate=emulate)
        for (name, robot), emulate in zip(
            ARENA.robots.items(), [("body",), ("wheels", "body"), ("wheels",), (), (), ()], strict=True
        )
    }
    found = access.leaves(msgspec.structs.replace(ARENA, robots=robots))
    assert {key for key in EVERY if covers(found["mock"].hears, key)} == {KEYS.feedback(next(iter(robots)))}
    assert covers(found["mock"].says, KEYS.virtual)
    assert covers(found["bridge"].hears, KEYS.virtual)


def test_who_is_not_in_the_register_is_in_no_rule() -> None:
    rules = access.rules(ARENA, {"r06": "r06.2", "station": "station"})["access_control"]
    assert rules["default_permission"] == "deny"
    assert {s["id"]: s["cert_common_names"] for s in rules["subjects"]} == {"r06": ["r06.2"], "station": ["station"]}
    assert {rule["permission"] for rule in rules["rules"]} == {"allow"}
    assert {name for policy in rules["policies"] for name in policy["subjects"]} == {"r06", "station"}


def test_zenoh_takes_the_rules() -> None:
    import json

    import zenoh

    config = zenoh.Config()
    for section, value in access.rules(ARENA, {name: name for name in (*ROLES, *ARENA.robots)}).items():
        config.insert_json5(section, json.dumps(value))


def test_an_empty_register_names_nobody() -> None:
    assert Register("lab").common_names() == {}
    assert not Register("lab").is_revoked("r06")


def test_a_robot_without_its_certificate_says_what_to_do(file: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "onboard", "run", "--arena", str(file), "--robot", "r06"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "unpack r06.tar beside the arena file" in done.stderr
