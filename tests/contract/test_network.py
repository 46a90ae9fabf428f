"""The network settings: what every session has in common, and a quality of service for every channel."""

import json

import pytest

from contract import network
from contract.keys import Keys

ENDPOINT = "tcp/127.0.0.1:7447"
ROLES = [network.router_config(ENDPOINT), network.client_config(ENDPOINT)]


@pytest.mark.parametrize("settings", ROLES)
def test_no_session_scouts_or_blocks(settings: network.Settings) -> None:
    table = {key: json.loads(value) for key, value in settings}
    assert table["scouting/multicast/enabled"] is False
    assert table["scouting/gossip/enabled"] is False
    assert table["transport/link/tx/lease"] == network.LEASE_MS
    assert len(table) == len(settings)


def test_router_listens_and_clients_only_connect() -> None:
    router, client = ({key: json.loads(value) for key, value in settings} for settings in ROLES)
    assert (router["mode"], router["listen/endpoints"], router["connect/endpoints"]) == ("router", [ENDPOINT], [])
    assert (client["mode"], client["listen/endpoints"], client["connect/endpoints"]) == ("client", [], [ENDPOINT])
    assert router["scouting/delay"] == 0


def test_every_channel_has_a_quality_of_service() -> None:
    channels = {name for name in vars(Keys) if not name.startswith("_")}
    assert set(network.QOS) == channels - {"everything", "kind", "robot_of", "presence"}


def test_no_channel_blocks_its_sender() -> None:
    assert {qos.congestion for qos in network.QOS.values()} == {"DROP"}
    assert all(network.QOS[name].reliability == "RELIABLE" for name in ("stop", "targets"))
    assert network.QOS["heartbeat"].reliability == "BEST_EFFORT", "told anew every 50 ms: it never waits for a lost one"


def test_names_are_members_of_zenoh() -> None:
    zenoh = pytest.importorskip("zenoh")
    for qos in network.QOS.values():
        assert getattr(zenoh.Priority, qos.priority)
        assert getattr(zenoh.CongestionControl, qos.congestion)
        assert getattr(zenoh.Reliability, qos.reliability)


@pytest.mark.parametrize("settings", ROLES)
def test_zenoh_accepts_every_setting(settings: network.Settings) -> None:
    zenoh = pytest.importorskip("zenoh")
    config = zenoh.Config()
    for key, value in settings:
        config.insert_json5(key, value)
