"""Running daemon as a source of states: one connection in a thread with an event loop of its own.

A caller in another thread can wait for a response without delaying the states.
"""

import asyncio
import threading
from collections.abc import Awaitable, Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

from armgate.apps.connection import Login
from armgate.client import ClientError, Description, Role, State, TimedOut, aio

RATE = 30.0
"""Rate of the requested states, 1/s."""
ANSWER = 10.0
"""Timeout of a response, s."""

T = TypeVar("T")


class Live:
    """Connection to a daemon.

    Args:
        address: ``HOST:PORT``.
        name: Name of this client.
        role: Requested role.
        login: Token and TLS.

    Raises:
        ClientError: The daemon cannot be reached; the text gives the reason.
    """

    description: Description

    def __init__(self, address: str, name: str, role: Role, login: Login) -> None:
        self.address, self.name, self.role, self.login = address, name, role, login
        self._state: State | None = None
        self._problem: str | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="live", daemon=True)
        self._thread.start()
        try:
            self._cell = self._run(aio.connect(address, name=name, role=role, **login))
            self.description = self._cell.description
            self._run(self._subscribe())
        except BaseException:
            self._end_loop()
            raise
        self._reader: Future[None] = asyncio.run_coroutine_threadsafe(self._read(), self._loop)

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, *_: object) -> None:
        self._run(self._leave())
        self._end_loop()

    # --- the source of states -------------------------------------------------------------------------------

    def asset(self, name: str) -> bytes:
        """Return the asset with this SHA-256; it is fetched once."""
        return self._run(self._cell.asset(name))

    def newest(self) -> State | None:
        """Return the newest state; None before the first."""
        return self._state

    @property
    def problem(self) -> str | None:
        """Reason why no more states arrive; None while they do."""
        return self._problem

    def describe(self, state: State) -> str:
        """Return the cell's running time in words."""
        return f"running, {state.time:.0f} s"

    # --- requests -------------------------------------------------------------------------------------------

    @property
    def operator(self) -> bool:
        """Return True if the granted role may reset stops."""
        return self._cell.welcome.role == "operator"

    @property
    def drives(self) -> bool:
        """Return True if the granted role may acquire robots."""
        return self._cell.welcome.role != "observer"

    async def stop(self, reason: str) -> str:
        """Stop the whole cell; return the outcome in words."""
        stopped = await self._ask(self._cell.stop(reason=reason))
        return f"stop {stopped.stop} is in force: {', '.join(stopped.robots)} come to rest"

    async def reset(self) -> str:
        """Reset every stop in force; return the outcome in words.

        Raises:
            Refused: Another operator has already reset a stop, or a robot is still moving.
        """
        state = self._state
        stops = {stop for entry in (state.entries if state else ()) for stop in entry.stops or ()}
        if not stops:
            return "no stop is in force"
        for stop in sorted(stops):
            await self._ask(self._cell.reset(stop))
        return f"reset {', '.join(map(str, sorted(stops)))}: robots may be acquired again"

    async def signal(self, name: str, value: float) -> None:
        """Share a number with the other clients.

        Raises:
            Refused: An earlier signal was refused, for example because another client owns its name.
        """
        await self._ask(self._cell.signal(name, value))

    async def _ask(self, work: Coroutine[Any, Any, T]) -> T:
        """Wait in the caller's event loop for a response from this object's loop."""
        answer = asyncio.wrap_future(asyncio.run_coroutine_threadsafe(work, self._loop))
        return await asyncio.wait_for(answer, ANSWER)

    # --- the loop's thread ---------------------------------------------------------------------------------

    async def _subscribe(self) -> None:
        # A state holds an entry of every robot: the ticks of the fastest robot are enough.
        fastest = min(self.description.robots, key=lambda robot: robot.period)
        every = max(1, int(1.0 / (RATE * fastest.period)))
        await self._cell.subscribe(every=every, robots=[fastest.name])

    async def _read(self) -> None:
        try:
            while True:
                try:
                    async for state in self._cell.states():
                        self._state = state
                except TimedOut as error:
                    # No robot's clock advances. If the connection is lost, this request raises the error.
                    await self._cell.ping()
                    self._problem = str(error)
        except ClientError as error:
            self._problem = str(error)

    async def _leave(self) -> None:
        self._reader.cancel()
        await self._cell.close()

    def _run(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(ANSWER)

    def _end_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def in_words(act: Awaitable[str]) -> tuple[bool, str]:
    """Await a user's request; return True if it succeeded, and its outcome in words."""
    try:
        return True, await act
    except ClientError as error:
        return False, str(error)
    except TimeoutError:
        return False, f"the daemon has not answered within {ANSWER:g} s"
