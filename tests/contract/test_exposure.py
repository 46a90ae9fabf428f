"""Which links the loader refuses, and what the others are called."""

import tomllib
from pathlib import Path

import pytest

from contract.arena import ArenaError, digest, load, parse
from contract.exposure import WARNING, exposure, host_of, is_loopback
from contract.network import client_config, identity, router_config
from tests.house.checkout import ROOT

BENCH = (ROOT / "groundstation" / "arenas" / "bench2.toml").read_text()


def faults(**link: object) -> dict[str, str]:
    table = tomllib.loads(BENCH)
    table["link"] = link
    try:
        parse(table, "test.toml")
    except ArenaError as error:
        return {fault.path: fault.allowed for fault in error.faults}
    return {}


@pytest.mark.parametrize(
    "link",
    [
        {"router": "tcp/127.0.0.1:7447"},
        {"router": "tcp/localhost:7447"},
        {"router": "tcp/[::1]:7447"},
        {"router": "tcp/127.9.8.7:7447", "insecure": True},
        {"router": "tcp/192.168.7.1:7447", "insecure": True},
        {"router": "quic/192.168.7.1:7447", "keys": "keys"},
        {"router": "tls/station.lab:7447", "keys": "keys"},
        {"router": "quic/10.0.0.1:7447", "keys": "keys", "listen": ["quic/0.0.0.0:7447", "tls/0.0.0.0:7447"]},
        {"router": "tcp/127.0.0.1:7447", "listen": ["tcp/127.0.0.1:7447"]},
    ],
)
def test_links_that_are_good(link: dict[str, object]) -> None:
    assert not faults(**link)


@pytest.mark.parametrize(
    ("link", "path", "words"),
    [
        ({"router": "tcp/192.168.7.1:7447"}, "link.router", "link.insecure = true"),
        ({"router": "tcp/station.lab:7447"}, "link.router", "without certificates"),
        ({"router": "tcp/127.0.0.1:7447", "listen": ["tcp/0.0.0.0:7447"]}, "link.listen[0]", "without certificates"),
        ({"router": "quic/192.168.7.1:7447"}, "link.router", "need certificates"),
        ({"router": "quic/192.168.7.1:7447", "insecure": True}, "link.router", "need certificates"),
        ({"router": "tls/127.0.0.1:7447"}, "link.router", "need certificates"),
        ({"router": "tcp/192.168.7.1:7447", "keys": "keys"}, "link.router", "write quic/"),
        ({"router": "tcp/192.168.7.1:7447", "keys": "keys", "insecure": True}, "link.insecure", "remove one"),
        ({"router": "quic/0.0.0.0:7447", "keys": "keys"}, "link.router", "no address to connect to"),
        ({"router": "quic/10.0.0.1:1", "keys": "keys", "listen": ["tls/0.0.0.0:1"]}, "link.listen", "no quic/"),
        ({"router": "udp/1.2.3.4:7"}, "link.router", "matching"),
    ],
)
def test_links_that_are_refused_say_why(link: dict[str, object], path: str, words: str) -> None:
    assert words in faults(**link)[path]


def test_a_robot_named_as_a_role_is_refused_where_there_are_keys() -> None:
    table = tomllib.loads(BENCH.replace("r06", "station"))
    parse(table, "loopback")
    table["link"] = {"router": "quic/10.0.0.1:7447", "keys": "keys"}
    with pytest.raises(ArenaError, match=r"robots\.station"):
        parse(table, "test.toml")


@pytest.mark.parametrize(
    ("endpoint", "host", "loopback"),
    [
        ("tcp/127.0.0.1:7447", "127.0.0.1", True),
        ("quic/[fe80::1]:7447?mixed_rel=1", "fe80::1", False),
        ("tls/localhost:1", "localhost", True),
        ("tls/localhost.evil.org:1", "localhost.evil.org", False),
        ("tcp/127.0.0.1.evil.org:1", "127.0.0.1.evil.org", False),
        ("tcp/0.0.0.0:1", "0.0.0.0", False),
    ],
)
def test_only_this_computer_is_loopback(endpoint: str, host: str, loopback: bool) -> None:
    assert host_of(endpoint) == host
    assert is_loopback(endpoint) == loopback
    assert exposure((endpoint,), "") == ("" if loopback else WARNING)
    assert exposure((endpoint,), "keys") == ""


def test_the_folder_of_keys_lies_beside_the_file_and_is_no_part_of_its_digest(tmp_path: Path) -> None:
    text = BENCH.replace('"tcp/127.0.0.1:7447"', '"quic/10.0.0.1:7447"\nkeys = "keys"')
    digests = set()
    for folder in ("a", "b"):
        path = tmp_path / folder / "lab.toml"
        path.parent.mkdir()
        path.write_text(text if folder == "a" else text.replace('"keys"', '"/etc/ahdc/keys"'))
        arena = load(path)
        assert arena.link.keys == (str(tmp_path / "a" / "keys") if folder == "a" else "/etc/ahdc/keys")
        digests.add(digest(arena))
    assert len(digests) == 1


def test_clients_prove_who_they_are_and_believe_only_a_named_router(tmp_path: Path) -> None:
    (tmp_path / "r06").mkdir()
    for name in ("ca.pem", "r06/certificate.pem", "r06/private.key"):
        (tmp_path / name).write_text("")
    who = identity(str(tmp_path), "r06")
    settings = dict(client_config("quic/10.0.0.1:7447", identity=who))
    assert settings["connect/endpoints"] == '["quic/10.0.0.1:7447?mixed_rel=1"]'
    for part in ('"verify_name_on_connect": true', '"enable_mtls": true', f'"{tmp_path}/r06/private.key"'):
        assert part in settings["transport/link/tls"]
    router = dict(router_config("tls/10.0.0.1:7447", ["tls/0.0.0.0:7447", "quic/0.0.0.0:7447"], who))
    assert router["transport/link/protocols"] == '["tls", "quic"]'
    assert '"enable_mtls": true' in router["transport/link/tls"]
    with pytest.raises(ArenaError, match=r"r08\.tar"):
        identity(str(tmp_path), "r08")
    assert identity("", "r06") is None
