"""Configuration of the daemon: clock, server, recording and metrics."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from armgate.cell.config.fields import Account, ConfigModel, Name, Period


class WallClockConfig(ConfigModel):
    """Wall clock: each robot ticks at its own period."""

    kind: Literal["wall"] = "wall"
    """Kind of the clock."""


class LockstepClockConfig(ConfigModel):
    """Lock-step: a tick happens when every participant has sent its commands or a pass."""

    kind: Literal["lockstep"]
    """Kind of the clock."""
    participants: Annotated[tuple[Name, ...], Field(min_length=1)]
    """Names of the participants, as in their hello."""
    grace: Period = 10.0
    """Time after which a silent participant is dropped [s]."""

    @model_validator(mode="after")
    def _once(self) -> Self:
        if len(set(self.participants)) != len(self.participants):
            raise ValueError("a participant is named twice; expected every name once")
        return self


class TlsConfig(ConfigModel):
    """Certificates and key for TLS, in PEM; paths are relative to the file that contains the key."""

    certificate: str
    """File of the server's certificate, followed by the certificates between it and its CA."""
    key: str
    """File of its private key, which must be unencrypted and not readable by all users."""
    client_ca: str | None = None
    """File of CAs; if given, each client must present a certificate that one of them has signed."""


class SocketConfig(ConfigModel):
    """Unix socket for clients on this machine; the kernel identifies the user of each client."""

    path: str
    """Path of the socket, relative to the file that contains the key."""
    users: Annotated[
        dict[str, Literal["observer", "controller", "operator"]], Field(min_length=1, max_length=256)
    ]
    """Highest role of each user, by name or number; other users are refused unless they have a token."""


class SignalRuleConfig(ConfigModel):
    """Permission to set the signals under a prefix."""

    role: Literal["controller", "operator"] = "controller"
    """Lowest role that may set them."""
    clients: Annotated[tuple[Account, ...], Field(min_length=1)] | None = None
    """Names of tokens, or ``uid N`` for users on the Unix socket; absent: all clients.

    If the server has neither tokens nor a socket, these are names of clients."""


class ServerConfig(ConfigModel):
    """Addresses on which the daemon listens, and limits for its clients."""

    host: str = "127.0.0.1"
    """Address to listen on; addresses other than loopback need ``tls`` and ``tokens``."""
    port: Annotated[int, Field(ge=0, le=65535)] = 7411
    """Port to listen on; 0 selects a free port."""
    tls: TlsConfig | None = None
    """Certificate and key; absent: no encryption."""
    tokens: str | None = None
    """File of tokens, see ``armgate token``; absent: roles are self-declared."""
    socket: SocketConfig | None = None
    """Unix socket to listen on as well; without ``tokens`` the daemon then listens on nothing else."""
    lease_ttl: Period = 1.0
    """Time after which a lease expires if its holder sends nothing [s]."""
    max_connections: Annotated[int, Field(ge=1, le=4096)] = 128
    """Largest number of connections at once; some are reserved for operators and controllers."""
    max_connections_per_address: Annotated[int, Field(ge=1, le=4096)] = 64
    """Largest number of connections from one address (IPv6: one network of 64 bits).

    It is also the largest number of sessions with one token."""
    connection_rate: Annotated[float, Field(gt=0.0)] = 100.0
    """Connections accepted on average, after the first 32 [1/s]; others wait in the system's queue."""
    signal_rate: Annotated[float, Field(gt=0.0)] = 1000.0
    """Signals that one client may send on average [1/s]; others are dropped."""
    signals_per_client: Annotated[int, Field(ge=1, le=64)] = 32
    """Largest number of signals of one client, of all clients with one token, or of one user.

    There are at most 64 signals in total."""
    signals: Annotated[dict[Name, SignalRuleConfig], Field(max_length=64)] = {}
    """Permissions by prefix of the signal's name; ``operator.`` is for operators unless it is listed."""
    message_rate: Annotated[float, Field(gt=0.0)] = 2000.0
    """Messages read from one client on average [1/s]; others wait. Not in lock-step."""
    message_rate_per_identity: Annotated[float, Field(gt=0.0)] = 3000.0
    """Messages read from all clients with one token, or at one address if there are no tokens [1/s]."""
    message_rate_per_address: Annotated[float, Field(gt=0.0)] = 4000.0
    """Messages read from all clients at one address [1/s]."""
    message_rate_in_all: Annotated[float, Field(gt=0.0)] = 6000.0
    """Messages read from all clients together [1/s]."""
    login_failures: Annotated[float, Field(ge=1.0)] = 100.0
    """Wrong tokens that are logged one by one, on average [1/min]; further ones are counted."""
    login_failures_per_address: Annotated[float, Field(ge=1.0)] = 10.0
    """Wrong tokens from one address that are logged one by one, on average [1/min]."""
    handshake_timeout: Period = 5.0
    """Timeout of the TLS handshake, and of the wait for the hello after it [s]."""
    send_buffer: Annotated[int, Field(ge=1 << 20)] = 1 << 22
    """Answers and verdicts that may wait for a client that does not read before it is disconnected [bytes].

    States are not counted."""
    robot_server: str | None = None
    """Socket of the robot server that runs the links, relative to the file that contains the key.

    Absent: the default socket if a robot is not emulated; otherwise the daemon itself runs the links."""


class RecordingConfig(ConfigModel):
    """Recording of events, outputs and states; it does not change the gate's decisions."""

    folder: str | None = None
    """Folder in which each start makes a folder named by the time; absent: recording only with
    ``armgate serve --record``."""
    required: bool = False
    """If true, the robots come to rest if a record cannot be written."""
    sign: str | None = None
    """File of a private key (Ed25519, PEM) that signs each file when it is closed; absent: no signature."""
    rotate: Annotated[int, Field(ge=1 << 20)] = 1 << 28
    """Size of a file at which the next file begins [bytes]."""
    queue: Annotated[int, Field(ge=256, le=1 << 20)] = 16384
    """Largest number of records that wait for the disk; further ones are lost, and the loss is reported."""


class MetricsConfig(ConfigModel):
    """Metrics for Prometheus, served on 127.0.0.1 only."""

    port: Annotated[int, Field(ge=0, le=65535)] | None = None
    """Port of the metrics; 0 selects a free port; absent: no metrics."""
