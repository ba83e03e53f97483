"""Requests that the server cancels when it stops."""

import asyncio

import httpx
import pytest
import uvicorn
from starlette.types import Receive, Scope, Send

from foldback.server.http.cut_requests import RETRY_S, CutRequests


@pytest.mark.parametrize("starts", [False, True])
def test_stopping_server_answers_503_where_no_answer_has_started(starts: bool) -> None:
    async def stop_during_request() -> httpx.Response:
        waits = asyncio.Event()

        async def wait_forever(scope: Scope, receive: Receive, send: Send) -> None:
            if starts:
                await send({"type": "http.response.start", "status": 200, "headers": []})
            waits.set()
            await asyncio.Event().wait()

        config = uvicorn.Config(
            CutRequests(wait_forever),
            port=0,
            lifespan="off",
            log_level="critical",
            timeout_graceful_shutdown=0,
        )
        server = uvicorn.Server(config)
        serving = asyncio.ensure_future(server.serve())
        while not server.started:
            await asyncio.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        async with httpx.AsyncClient(trust_env=False) as client:
            request = asyncio.ensure_future(client.get(f"http://127.0.0.1:{port}/"))
            await waits.wait()
            server.should_exit = True
            await serving
            return await request

    if starts:
        with pytest.raises(httpx.RemoteProtocolError):
            asyncio.run(stop_during_request())
        return
    answer = asyncio.run(stop_during_request())
    assert (answer.status_code, answer.json()["code"]) == (503, "stopping")
    assert answer.headers["retry-after"] == str(RETRY_S)
