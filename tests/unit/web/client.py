"""A client that asks an application directly, without a server in between."""

from __future__ import annotations

import asyncio
from typing import Any

import httpx
from fastapi import FastAPI


class Client:
    """Each request on a loop of its own; redirects are not followed."""

    def __init__(
        self,
        app: FastAPI,
        base_url: str = "http://127.0.0.1:8617",
        headers: dict[str, str] | None = None,
        address: str = "127.0.0.1",
    ) -> None:
        self._app = app
        self._base_url = base_url
        self._headers = headers or {}
        self._address = address

    def request(self, method: str, path: str, **more: Any) -> httpx.Response:
        return asyncio.run(self._ask(method, path, **more))

    def get(self, path: str, **more: Any) -> httpx.Response:
        return self.request("GET", path, **more)

    def post(self, path: str, **more: Any) -> httpx.Response:
        return self.request("POST", path, **more)

    async def _ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        transport = httpx.ASGITransport(app=self._app, client=(self._address, 50_000))
        async with httpx.AsyncClient(transport=transport, base_url=self._base_url, headers=self._headers) as client:
            return await client.request(method, path, **more)
