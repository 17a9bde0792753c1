"""Addresses of a Ray cluster: what is none is refused before anybody is asked for it."""

import socket

import pytest
from ibrid_search.evaluation.ray_session import is_host, require_cluster

from ibrid.errors import IbridError

NONE = [
    "host",
    ":1",
    "host:",
    "host:0",
    "host:65536",
    "host:1e3",
    "host:-1",
    "a b:6379",
    "a\n:6379",
    "ray://host:10001",
    "http://h:1",
    "::1:6379",
    "[::1:6379",
    "[::g]:6379",
    "1.2.3:6379",
    "1.2.3.400:6379",
    "a..b:6379",
    "-a:6379",
    "a-:6379",
    "a/b:6379",
    f"{'a' * 64}:6379",
    f"{'a.' * 200}b:6379",
    "\u00e9:6379",
    "host:\u0663",
    "a@b:6379",
    "%:1",
    "host:6379 ",
]


def test_what_is_no_address_is_refused_before_anybody_is_asked(monkeypatch: pytest.MonkeyPatch):
    asked: list[object] = []
    monkeypatch.setattr(socket, "create_connection", lambda *one, **_: asked.append(one))
    missed = []
    for address in NONE:
        try:
            require_cluster(address)
            missed.append(address)
        except IbridError as error:
            if "is named by HOST:PORT of its head" not in str(error) or "\n" in str(error):
                missed.append(str(error))
    assert not missed
    assert not asked


def test_names_and_addresses_of_machines_are_hosts():
    assert all(map(is_host, ["localhost", "node-1.example.org", "a_b", "127.0.0.1", "[::1]"]))
