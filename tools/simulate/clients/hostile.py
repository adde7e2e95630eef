"""Hostile clients: malicious ones, crowds of connections, and a second daemon at the robot server."""

import asyncio
import contextlib
import random

from armgate.links.robot_server.codec import CodecError, Decoder
from armgate.links.robot_server.codec import encode as encode_frame
from armgate.links.robot_server.messages import FORMAT, Heartbeat, Hello, ResumePoint, Welcome
from armgate.protocol import VERSIONS, encode
from armgate.protocol import messages as m
from tools.simulate.clients.behaviour import ADDRESS, RawClient, Setting


class Vandal(RawClient):
    """Malicious client: wrong bytes, floods, half messages, connections without a hello."""

    pause = (0.0, 0.3)

    def greet(self) -> None:
        """Send hello, or not."""
        if self.rng.random() < 0.7:
            super().greet()

    @property
    def ready(self) -> bool:
        """True: this client does not wait for a welcome."""
        return True

    async def live(self) -> None:
        """Act until the connection ends; disconnect while all is calm."""
        if not self.setting.calm:
            await super().live()
        else:
            await asyncio.sleep(0.5)

    def act(self) -> None:
        """Send something harmful."""
        if self.setting.calm:
            self.wire.abort()
            return
        message = m.Command(
            robot=self.any_robot(), fence=self.rng.randint(0, 9), seq=self._seq, tick=0, dq=(0.1, 0.1)
        )
        match self.rng.randrange(7):
            case 6:
                self._ask_anything()
            case 0:
                self.wire.mangle(self.rng.randbytes(self.rng.randint(1, 200)))
            case 1:
                data = encode(message)
                self.wire.mangle(data[: self.rng.randint(1, len(data))])
            case 2 | 3 | 4:
                self._flood(message)
            case _:
                self.rng.choice((self.wire.abort, self.wire.close))()

    def _ask_anything(self) -> None:
        """Send requests that few clients send."""
        robot, number = self.any_robot(), self.rng.randint(0, 40)
        requests: list[m.Request] = [
            m.Asset(hash=f"{number:064x}", offset=number),
            m.Subscribe(every=number, robots=(robot,), fields=("q",)),
            m.Subscribe(every=1, robots=("nothing",)),
            m.Reset(stop=number),
            m.Kick(session=f"s{number}"),
            m.Acquire(robot=robot, takeover=True),
            m.Release(robot=robot, fence=number),
            m.Hello(name=self.name, versions=VERSIONS),
        ]
        self.wire.ask(self.rng.choice(requests))
        self.ping()
        if number < 5:
            self.wire.send(m.Pass(step=number))
        elif number < 8:
            self.wire.send(m.Bye(reason="a simulated end"))

    def _flood(self, message: m.Command) -> None:
        """Send many messages at once."""
        match self.rng.randrange(4):
            case 0:
                for _ in range(self.rng.randint(10, 400)):
                    self.command(message.robot, message.fence, 0, (0.01, 0.01))
            case 1:
                self.wire.pause()
                for _ in range(self.rng.randint(1, 40)):
                    self.wire.ask(m.Describe())
            case 2:
                for _ in range(self.rng.randint(1, 20)):
                    self.wire.ask(m.Stop(robot=message.robot, reason="x" * self.rng.randint(0, 300)))
            case _:
                for _ in range(self.rng.randint(1, 80)):
                    self.wire.ask(m.Signal(name=f"v{self.rng.randint(0, 90)}", value=(1.0,)))


class Crowd:
    """Client that opens many connections, and sends nothing or too little over them."""

    def __init__(self, name: str, setting: Setting, rng: random.Random) -> None:
        self.name, self.setting, self.rng = name, setting, rng

    async def run(self) -> None:
        """Open and close connections until all is calm."""
        loop = asyncio.get_running_loop()
        while not self.setting.over:
            opened = []
            for _ in range(0 if self.setting.calm else self.rng.randint(1, 30)):
                with contextlib.suppress(OSError, TimeoutError):
                    async with asyncio.timeout(0.2):
                        transport, _ = await loop.create_connection(asyncio.Protocol, *ADDRESS)
                        opened.append(transport)
                        transport.write(self.rng.randbytes(self.rng.choice((0, 0, 1, 3))))
            await asyncio.sleep(self.rng.uniform(0.0, 1.0))
            for transport in opened:
                self.rng.choice((transport.abort, transport.close))()
            await asyncio.sleep(self.rng.uniform(0.1, 2.0))


class Rival(asyncio.Protocol):
    """Second daemon at the robot server: it must not get the robots while another daemon holds them."""

    def __init__(self, name: str, setting: Setting, rng: random.Random) -> None:
        self.name, self.setting, self.rng = name, setting, rng
        self._decoder = Decoder()

    async def run(self) -> None:
        """Connect again and again until all is calm."""
        loop = asyncio.get_running_loop()
        while not self.setting.over:
            await asyncio.sleep(self.rng.uniform(0.05, 0.8))
            if self.setting.calm:
                continue
            with contextlib.suppress(OSError):
                self._decoder = Decoder()
                transport, _ = await loop.create_unix_connection(lambda: self, self.setting.robots)
                self._greet(transport)
                await asyncio.sleep(self.rng.uniform(0.0, 0.4))
                self.rng.choice((transport.abort, transport.close))()

    def _greet(self, transport: asyncio.WriteTransport) -> None:
        """Send the hello of a daemon, part of it, another message, or random bytes."""
        robots = tuple(ResumePoint(robot, 0, 0) for robot in self.setting.steps)
        hello = encode_frame(Hello(FORMAT, self.setting.cell, "rival", robots))
        part = hello[: self.rng.randint(0, len(hello))]
        choices = (hello, hello, hello, part, encode_frame(Heartbeat()), self.rng.randbytes(9))
        transport.write(self.rng.choice(choices))

    def data_received(self, data: bytes) -> None:
        """Check that a welcome is received only if no other daemon holds the robots."""
        try:
            messages = self._decoder.push(data)
        except CodecError as error:
            self.setting.findings.report("readable messages", f"{self.name}: {error}")
            return
        if any(isinstance(message, Welcome) for message in messages) and self.setting.robots_held():
            self.setting.findings.report("one daemon holds the robots", self.name)
