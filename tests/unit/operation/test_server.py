"""A client of the real server, over a storm day with faults."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from resilience.case.write import case_text
from resilience.errors import UsageError
from resilience.operation.journal import read_journal
from tests.unit.operation.plant import Plant, simulated, storm_case, storm_world

pytest.importorskip("fastapi")
pytest.importorskip("uvicorn")

import uvicorn

from resilience.operation.operator import Operator
from resilience.operation.server import check_exposure, serve

JSON = {"Content-Type": "application/json"}
START_S = 120.0


class Client:
    """Asks a server as any program would, over one connection per thread."""

    def __init__(self, process: subprocess.Popen[str], address: str) -> None:
        self.process, self.address = process, urlsplit(address)

    def ask(
        self,
        method: str,
        path: str,
        body: bytes | Mapping[str, Any] | None = None,
        headers: Mapping[str, str] = JSON,
    ) -> tuple[int, Any]:
        """Status and answer."""
        assert self.address.hostname is not None
        with closing(HTTPConnection(self.address.hostname, self.address.port, timeout=60)) as link:
            data = json.dumps(body).encode() if isinstance(body, Mapping) else body
            link.request(method, path, data, dict(headers))
            answer = link.getresponse()
            return answer.status, json.loads(answer.read() or "null")

    def decide(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """The decision for a state that is in order."""
        status, answer = self.ask("POST", "/decide", state)
        assert status == 200, answer
        decided: dict[str, Any] = answer
        return decided


@contextmanager
def serving(folder: Path, *arguments: str, **environment: str) -> Iterator[Client]:
    """A server of `case.toml` in a folder, until the block ends."""
    import os

    command = [sys.executable, "-m", "resilience", "serve", "case.toml", "--port", "0", *arguments]
    process = subprocess.Popen(
        command, cwd=folder, env=os.environ | environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()  # empty where it ends without one
        if not line.startswith("serving at "):
            raise AssertionError(process.communicate()[1])
        yield Client(process, line.split()[-1])
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "case.toml").write_text(case_text(CASE), encoding="utf-8")
    return tmp_path


CASE = storm_case(slots=32, step_min=45.0)
WORLD = storm_world(CASE)


def test_a_storm_day_with_faults_costs_what_the_simulator_says(folder: Path) -> None:
    expected, plant = simulated(WORLD, "stochastic"), Plant(WORLD)
    given: dict[int, dict[str, float]] = {}

    def day(client: Client, first: int, stop: int) -> None:
        for t in range(first, stop):
            answer = client.decide(plant.state(t))
            assert (answer["slot"], answer["fallback"]) == (t, None)
            given[t] = answer["power_mw"]
            plant.act(t, answer["power_mw"])

    options = ("--method", "stochastic", "--late", "60", "--log", "log.jsonl")
    with serving(folder, *options) as client:
        day(client, 0, 6)
        # Missing fields: nothing is decided of them.
        state = plant.state(6)
        for key in ("time", "down", "energy_mwh"):
            status, answer = client.ask(
                "POST", "/decide", {k: v for k, v in state.items() if k != key}
            )
            assert (status, answer["mistakes"][0]["value"]) == (422, "nothing")
        day(client, 6, 10)
        # The clock jumps back, and out of the horizon.
        assert (
            client.decide(plant.state(10) | {"time": plant.state(3)["time"]})["power_mw"]
            == given[3]
        )
        assert (
            client.ask("POST", "/decide", plant.state(10) | {"time": "2017-01-01T00:00"})[0] == 422
        )
        day(client, 10, 14)
        with ThreadPoolExecutor(100) as pool:  # all of them at once
            answers = list(pool.map(lambda _: client.decide(plant.state(14)), range(100)))
        assert Counter(answer["repeated"] for answer in answers) == {False: 1, True: 99}
        assert all(answer["power_mw"] == answers[0]["power_mw"] for answer in answers)
        day(client, 14, 17)
        # Killed after it has decided, before the plant has heard of it.
        lost = client.decide(plant.state(17))
        client.process.kill()
    with serving(folder, *options) as client:
        again = client.decide(plant.state(17))
        assert again == lost | {"repeated": True}
        assert client.ask("GET", "/health")[1]["decisions"] == 18
        day(client, 17, CASE.slots)
        health = client.ask("GET", "/health")[1]
        assert (health["status"], health["by_rule"], health["warnings"]) == ("ok", 0, [])
        assert health["decisions"] == CASE.slots
    assert plant.cost == pytest.approx(expected.cost.sum(), abs=1e-6)
    slots = [record["answer"]["slot"] for record in read_journal(folder / "log.jsonl")[1]]
    assert slots == [*range(CASE.slots)]
    for t, record in enumerate(read_journal(folder / "log.jsonl")[1]):
        assert record["answer"]["power_mw"] == given[t]


def test_it_says_what_it_takes_and_refuses_the_rest(folder: Path) -> None:
    with serving(folder, "--method", "rule-0.9") as client:
        state = Plant(WORLD).state(3)
        status, about = client.ask("GET", "/openapi.json")
        assert status == 200
        assert set(about["paths"]) == {"/decide", "/plan", "/health"}
        schemas = about["components"]["schemas"]
        assert schemas["State"]["required"] == ["time", "down"]
        answer = client.decide(state)
        assert set(answer) == set(schemas["Answer"]["properties"])
        for reference in _references(about):
            assert reference.removeprefix("#/components/schemas/") in schemas
        assert client.ask("GET", "/docs")[0] == 404  # its scripts would come from elsewhere
        plan = client.ask("GET", "/plan")[1]
        assert plan["steps"][0]["energy_mwh"] == answer["energy_mwh"]
        assert plan["steps"][0]["begins"] == answer["begins"]

        assert client.ask("POST", "/decide", b"{")[0] == 400
        assert client.ask("POST", "/decide", b"[" * 100_000)[0] == 400
        assert client.ask("POST", "/decide", b"[]")[0] == 422
        assert client.ask("POST", "/decide", b'{"time": "\\ud800"}')[0] == 422
        assert client.ask("POST", "/decide", b" " * 2**20 + b"{}")[0] == 413
        plain = {"Content-Type": "text/plain"}
        assert client.ask("POST", "/decide", b"{}", plain)[0] == 415
        elsewhere = JSON | {"Host": "rebound.example.org"}
        assert client.ask("POST", "/decide", state, elsewhere)[0] == 403
        assert client.ask("GET", "/health")[1]["decisions"] == 1


def _references(value: Any) -> Iterator[str]:
    """Every reference in a description."""
    if isinstance(value, dict):
        if isinstance(value.get("$ref"), str):
            yield value["$ref"]
        for inner in value.values():
            yield from _references(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _references(inner)


def test_a_body_without_an_end_is_read_no_further_than_the_limit(folder: Path) -> None:
    import socket

    with serving(folder, "--method", "rule-0.9") as client:
        with socket.create_connection((client.address.hostname, client.address.port)) as link:
            head = "Host: localhost\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked"
            link.sendall(f"POST /decide HTTP/1.1\r\n{head}\r\n\r\n".encode())
            chunk = b"10000\r\n" + b" " * 2**16 + b"\r\n"
            for _ in range(18):
                link.sendall(chunk)
            link.settimeout(30.0)
            assert b" 413 " in link.recv(4096).splitlines()[0]
        assert client.ask("GET", "/health")[0] == 200


def test_others_need_a_token(folder: Path) -> None:
    token = "f3b1c95d7a4e2860"
    with serving(folder, "--method", "rule-0.9", RESILIENCE_TOKEN=token) as client:
        state = Plant(WORLD).state(3)
        for sent in ({}, {"Authorization": "Bearer f3b1c95d7a4e2861"}, {"Authorization": token}):
            assert client.ask("POST", "/decide", state, JSON | sent)[0] == 401
            assert client.ask("GET", "/plan", None, JSON | sent)[0] == 401
        allowed = JSON | {"Authorization": f"Bearer {token}", "Host": "plant.example.org"}
        assert client.ask("POST", "/decide", state, allowed)[0] == 200
        assert client.ask("GET", "/health")[1]["decisions"] == 1  # it says nothing of the plant


@pytest.mark.parametrize(
    ("host", "token", "words"),
    [
        ("0.0.0.0", None, "without a token"),
        ("192.168.0.7", None, "without a token"),
        ("127.0.0.1", "short", "a token of 5 characters"),
        ("0.0.0.0", "ü" * 20, "in ASCII"),
    ],
)
def test_no_exposure_without_a_token(host: str, token: str | None, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        check_exposure(host, token)


def test_a_port_in_use_is_said(folder: Path) -> None:
    with serving(folder, "--method", "rule-0.9") as client:
        done = subprocess.run(
            [sys.executable, "-m", "resilience", "serve", "case.toml", "--method", "rule-0.9",
             "--log", "other.jsonl", "--port", str(client.address.port)],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: cannot listen at 127.0.0.1, port {client.address.port}")


def test_a_server_that_is_told_to_end_ends(folder: Path) -> None:
    with serving(folder, "--method", "rule-0.9") as client:
        client.decide(Plant(WORLD).state(3))
        began = time.monotonic()
        client.process.terminate()
        client.process.wait(30.0)
        assert time.monotonic() - began < 20.0


def test_an_answer_in_two_packets_does_not_wait_for_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An accepted connection inherits the option; what answers in 40 ms else decides in 6."""
    delays: list[int] = []

    def served(_: uvicorn.Server, sockets: list[socket.socket]) -> None:
        option = socket.IPPROTO_TCP, socket.TCP_NODELAY
        with socket.create_connection(sockets[0].getsockname()[:2]):
            accepted, _address = sockets[0].accept()
            with accepted:
                delays.append(accepted.getsockopt(*option))

    monkeypatch.setattr(uvicorn.Server, "run", served)
    with Operator(storm_case(slots=4), "rule-0.9") as operator:
        serve(operator, port=0)
    assert delays == [1]
