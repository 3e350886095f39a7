"""An operator over HTTP: `/decide`, `/plan`, `/health`, and what they take and give in
`/openapi.json`.

Only this machine is served without a token. A page in a browser of this machine cannot ask either:
bodies must say that they are JSON, and the host that is asked for must be this machine.
"""

from __future__ import annotations

import json
import secrets
import socket
from collections.abc import Callable
from typing import Any, NoReturn

from fastapi import Depends, FastAPI, HTTPException, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.openapi.utils import get_openapi
from fastapi.responses import JSONResponse
from pydantic import TypeAdapter

from resilience.errors import CaseError, ResilienceError, UsageError
from resilience.operation.answer import OperatorAnswer
from resilience.operation.operator import Operator
from resilience.operation.state import StateTable

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names of this machine, which is served without a token."""
MAX_BODY_BYTES = 2**20
MAX_CONNECTIONS = 512
TOKEN_VARIABLE = "RESILIENCE_TOKEN"
MIN_TOKEN = 16
"""Characters of a token."""


class AsciiResponse(JSONResponse):
    """JSON in ASCII: it can say what nobody can encode, as half of a pair of surrogates."""

    def render(self, content: Any) -> bytes:
        """The bytes that are sent."""
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode("ascii")


def application(
    operator: Operator, *, token: str | None = None, max_body_bytes: int = MAX_BODY_BYTES
) -> FastAPI:
    """The service of an operator, for any ASGI server of one process.

    Args:
        operator: who decides; it outlives the service.
        token: what callers must send as `Authorization: Bearer TOKEN`; None: only calls to this
            machine by one of its own names are answered.
        max_body_bytes: of a state; larger ones are refused unread.
    """
    from importlib.metadata import version

    app = FastAPI(
        title=f"resilience: {operator.method} in {operator.setting.case.name}",
        version=version("resilience"),
        docs_url=None,  # their scripts come from elsewhere
        redoc_url=None,
    )
    app.add_exception_handler(ResilienceError, _refused)
    guarded = [Depends(_guard(token))]

    @app.post("/decide", dependencies=guarded, responses=_ANSWERS, openapi_extra=_STATE)
    async def decide(request: Request) -> AsciiResponse:
        """The set-points of the slot in which the state is; asked twice, the same ones."""
        state = _parsed(await _body(request, max_body_bytes))
        answer = await run_in_threadpool(operator.decide, state)
        return AsciiResponse(answer.summary())

    @app.get("/plan", dependencies=guarded)
    def plan() -> dict[str, Any]:
        """The plan behind the decision made last, step by step."""
        return operator.plan_summary()

    @app.get("/health")
    def health() -> dict[str, Any]:
        """Whether decisions are made and logged, how many, and how many by the rule."""
        return operator.health()

    _describe(app)
    return app


_STATE: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/json": {"schema": {"$ref": "#/components/schemas/State"}}},
    }
}
_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Answer"}}},
        "description": "set-points of the slot, who decided, and why",
    },
    400: {"description": "no JSON"},
    401: {"description": "no token, or a wrong one"},
    413: {"description": "too large"},
    415: {"description": "not application/json"},
    422: {"description": "a state with mistakes; all of them are listed"},
}


def _describe(app: FastAPI) -> None:
    """Adds what a state and an answer hold to the service's description of itself."""

    def described() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = get_openapi(title=app.title, version=app.version, routes=app.routes)
            answer = TypeAdapter(OperatorAnswer).json_schema(
                ref_template="#/components/schemas/{model}", mode="serialization"
            )
            schemas = schema.setdefault("components", {}).setdefault("schemas", {})
            schemas |= answer.pop("$defs", {})
            schemas |= {"State": StateTable.model_json_schema(), "Answer": answer}
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = described  # type: ignore[method-assign]  # as FastAPI's manual has it


def _guard(token: str | None) -> Callable[[Request], None]:
    """What lets nobody in but those who may."""

    def guard(request: Request) -> None:
        if token is None:
            if request.url.hostname not in LOOPBACK:
                _refuse(403, "the host asked for is not this machine; allowed: 127.0.0.1")
            return
        scheme, _, sent = request.headers.get("authorization", "").partition(" ")
        same = secrets.compare_digest(sent.strip().encode(), token.encode())
        if scheme.lower() != "bearer" or not same:
            _refuse(401, "no token, or a wrong one; allowed: Authorization: Bearer TOKEN")

    return guard


def _refuse(status: int, text: str) -> NoReturn:
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    raise HTTPException(status, text, headers)


async def _body(request: Request, limit: int) -> bytes:
    """The body of a request, read no further than the limit."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        _refuse(415, f"a body of type {kind or 'none'}; allowed: application/json")
    stated = request.headers.get("content-length", "")
    if stated.isascii() and stated.isdigit() and int(stated) > limit:
        _refuse(413, f"a body of {stated} bytes; allowed: {limit}")
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > limit:
            _refuse(413, f"a body of more than {limit} bytes; allowed: {limit}")
    return bytes(body)


def _parsed(body: bytes) -> Any:
    try:
        return json.loads(body)
    except (ValueError, RecursionError) as error:
        text = "too deep" if isinstance(error, RecursionError) else str(error)
        _refuse(400, f"the body is no JSON: {text}")


async def _refused(_: Request, error: Exception) -> AsciiResponse:
    """What a caller is told of an error of the package."""
    assert isinstance(error, ResilienceError)
    content: dict[str, Any] = {"detail": error.message, "hint": error.hint}
    if isinstance(error, CaseError):
        keys = ("key", "value", "allowed", "hint")
        content["mistakes"] = [{k: getattr(m, k) for k in keys} for m in error.mistakes]
        return AsciiResponse(content, 422)
    return AsciiResponse(content, 409 if isinstance(error, UsageError) else 500)


def check_exposure(host: str, token: str | None) -> None:
    """Refuses to serve others than this machine without a token that cannot be guessed.

    Raises:
        UsageError: it would.
    """
    if token is None and host not in LOOPBACK:
        raise UsageError(
            f"--host {host} without a token; allowed: 127.0.0.1, or a token",
            hint=f"set {TOKEN_VARIABLE}, to what `openssl rand -hex 16` prints, say",
        )
    if token is not None and (len(token) < MIN_TOKEN or not token.isascii()):
        raise UsageError(
            f"a token of {len(token)} characters; allowed: {MIN_TOKEN} or more, in ASCII",
            hint="`openssl rand -hex 16` prints one",
        )


def serve(
    operator: Operator,
    *,
    host: str = "127.0.0.1",
    port: int = 8000,
    token: str | None = None,
    on_ready: Callable[[str], None] | None = None,
) -> None:
    """Serves an operator until the process is told to end.

    Args:
        operator: who decides.
        host: address that is listened at.
        port: likewise; 0: any that is free.
        token: see `application`; needed for any host but this machine.
        on_ready: is called with the address, once it is listened at.

    Raises:
        UsageError: a host without a token, or a port that cannot be listened at.
    """
    import uvicorn

    check_exposure(host, token)
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listener = socket.create_server((host, port), family=family, backlog=MAX_CONNECTIONS)
    except OSError as error:
        raise UsageError(
            f"cannot listen at {host}, port {port}: {error.strerror or error}",
            hint="name another --port, or 0 for any that is free",
        ) from None
    with listener:
        # Else an answer in two packets waits 40 ms for its first half to be acknowledged.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        address = f"[{host}]" if ":" in host else host
        if on_ready is not None:
            on_ready(f"http://{address}:{listener.getsockname()[1]}")
        config = uvicorn.Config(
            application(operator, token=token),
            log_level="warning",
            limit_concurrency=MAX_CONNECTIONS,
            timeout_keep_alive=30,
            server_header=False,
        )
        uvicorn.Server(config).run(sockets=[listener])
