"""Settings of the operator, all given by environment variables ``FOLDBACK_…``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from contextlib import suppress
from difflib import get_close_matches
from functools import cached_property
from importlib.util import find_spec
from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from urllib.parse import urlsplit

from pydantic import (
    Field,
    NonNegativeFloat,
    PositiveFloat,
    SecretStr,
    ValidationInfo,
    field_validator,
)
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from foldback.planner.storage.files import MAX_FILE_BYTES, refuses_writing

MIB_BYTES = 1024 * 1024
"""Number of bytes in a MiB."""
VARIABLE_PREFIX: Final = "FOLDBACK_"
LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")
"""Names of this machine for itself, besides the other addresses 127.…."""
MIN_TOKEN_LENGTH: Final = 16
"""Minimum length of an operator's access token, in characters; the service does not start with a
shorter one."""
Count = Annotated[int, Field(ge=1)]
"""Whole number, at least 1."""
Names = Annotated[tuple[str, ...], NoDecode]
"""Names, separated by commas in an environment variable."""


class Settings(BaseSettings):
    """All settings, with defaults for one small machine."""

    model_config = SettingsConfigDict(
        env_prefix=VARIABLE_PREFIX,
        frozen=True,
        extra="ignore",
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )

    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = Field(default=8000, ge=0, le=65535)
    """Port to listen on; 0 picks a free one."""
    base_path: str = Field(default="", pattern=r"^(/[A-Za-z0-9_.~-]+)*$")
    """Path of the service behind a proxy, such as `/fold`. Default: the root."""
    data_dir: Path = Path("data")
    """Directory for the folds and the database."""
    database_url: str | None = None
    """Database address, such as postgresql://…. Needs pip install 'foldback[storage]'. Default:
    SQLite in `FOLDBACK_DATA_DIR`."""
    storage_url: str | None = None
    """Object store for the files of folds, such as s3://bucket/prefix, configured by the usual
    AWS_… variables. Needs pip install 'foldback[storage]'. Default: the files are in
    `FOLDBACK_DATA_DIR`."""
    cache_bytes: int = Field(default=2048 * MIB_BYTES, ge=MIB_BYTES)
    """Disk space for local copies of files from the object store."""
    storage_bytes: int | None = Field(default=None, ge=MIB_BYTES)
    """Storage for all folds. When it is full, files that can be recreated are deleted first, then
    the folds that were viewed longest ago."""
    storage_of_visitor_bytes: int | None = Field(default=None, ge=MIB_BYTES)
    """Storage for the folds of one visitor, waiting folds included. Exports, pictures and movies do
    not count."""
    keep_days: float | None = Field(default=None, gt=0)
    """Days after which a fold that is not viewed is deleted. Default: never. Gallery folds, and
    folds pinned with `foldback admin pin`, stay."""
    imprint_url: str | None = None
    """Address of a page about the operator of the service, such as https://…. The page `/privacy`
    links to it."""
    origins: Names = ()
    """Other origins (scheme://host), separated by commas, whose pages may change folds of this
    service."""
    allowed_hosts: Names = ()
    """Host names that requests may use, separated by commas; * allows any name, *.example.org all
    subdomains. This machine's own names are always allowed. Default: no other names if
    the service listens on a loopback address, any name if it listens on a public address. If the
    service has a public address or a proxy, set this variable to prevent DNS rebinding."""

    log_format: Literal["text", "json"] = "text"
    """Format of log lines: text for people, or JSON."""
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    """Lowest level of logged messages."""
    metrics_public: bool = False
    """Let anyone who reaches the service directly read `/metrics`, without
    `FOLDBACK_METRICS_TOKEN`. Requests through a proxy are always refused."""
    metrics_token: SecretStr | None = None
    """Token (at least 16 characters) for `/metrics`, sent as `Authorization: Bearer …`. Without a
    token, `/metrics` is closed, even to this machine."""
    leave_s: NonNegativeFloat = 0.0
    """Time between the signal to stop and the end of `serve`. Meanwhile `/ready` returns 503, so
    that a load balancer stops sending requests."""
    otlp_endpoint: str | None = None
    """Address to which workers send OpenTelemetry traces of folds (OTLP over HTTP), such
    as http://host:4318/v1/traces; needs the extra `foldback[otel]`."""
    trusted_proxies: Names = ("127.0.0.0/8", "::1")
    """Addresses or networks of proxies, separated by commas. X-Forwarded-For and X-Forwarded-Proto
    are accepted from these proxies and ignored from other senders."""

    workers: int = Field(default=1, ge=0, le=64)
    """Number of worker processes that `serve` starts."""
    folds_per_worker: int = Field(default=1, ge=1, le=64)
    """Number of long folds that a worker computes at once. In addition, it computes the same number
    of short folds (up to 10 s)."""
    prewarm: bool = True
    """Load the libraries of computing processes at start. `false` saves about 200 MB of memory
    until the first upload and the first fold, which then take one or two seconds longer."""
    shipped_folds: bool = True
    """Add the package's finished folds to a new database. Folds that were deleted are not added
    again."""
    lease_s: PositiveFloat = 15.0
    """Time without a sign of life after which PostgreSQL releases the name of a worker that is
    suspended or cut off; other workers then take over its folds. `serve` kills a worker of its own
    that is silent for twice this time. A worker that has ended is noticed at once."""
    drain_s: NonNegativeFloat = 0.0
    """Time for which a stopping worker may finish its folds. Folds that are not finished by then go
    back to the queue."""
    largest_queue: Count = 256
    """Maximum number of queued and running folds. If only one network has folds, it may use half of
    these places; two networks may use a third each, three a quarter each, and so on."""
    largest_queue_of_visitor: Count = 16
    """Maximum number of queued and running folds of one visitor."""
    largest_queue_seconds: PositiveFloat = 7200.0
    """Maximum estimated computing time of all queued and running folds, s. Networks share this
    time in the same way as the places of `FOLDBACK_LARGEST_QUEUE`."""
    largest_queue_seconds_of_visitor: PositiveFloat = 1800.0
    """Maximum estimated computing time of one visitor's queued and running folds, s. If a
    visitor has only one fold, this fold may take longer."""

    slice_seconds: PositiveFloat = 30.0
    """Computing time after which a fold pauses if shorter folds wait, s. This time triples after
    each pause."""

    max_upload_bytes: int = Field(default=MAX_FILE_BYTES, ge=1024, le=MAX_FILE_BYTES)
    """Maximum size of an upload; at most 64 MiB, the largest file that foldback can read."""
    max_uploads: Count = 24
    """Maximum number of uploads that are received or read at once."""
    max_uploads_of_visitor: Count = 6
    """Maximum number of uploads that one visitor may send at once."""
    upload_seconds: PositiveFloat = 120.0
    """Maximum duration of an upload."""
    upload_idle_s: PositiveFloat = 15.0
    """Time without data after which an upload is cancelled."""
    header_seconds: PositiveFloat = 20.0
    """Maximum time until a new connection has sent its request."""
    unread_seconds: PositiveFloat = 60.0
    """Time after which a connection is closed if its client reads nothing."""
    max_connections: Count = 2000
    """Maximum number of open connections."""
    max_connections_of_visitor: Count = 256
    """Maximum number of connections that one visitor may have open. A trusted proxy may open as
    many as `FOLDBACK_MAX_CONNECTIONS` allows."""
    requests_per_second_of_visitor: PositiveFloat = 100.0
    """Maximum average number of requests per second by one visitor. A visitor may also cause 40
    times as many protocol events per second, such as chunks or WebSocket frames."""
    requests_at_once_of_visitor: Count = 2000
    """Maximum number of requests that one visitor may send at once after a pause."""
    lists_per_second_of_visitor: PositiveFloat = 5.0
    """Maximum average number of lists (`/api/mine`, `/api/folds`, `/gallery`, `/`) that one visitor
    may load per second. After a pause, a visitor may load 20 times as many at once."""
    max_modules: int = Field(default=12_000, ge=3)
    """Maximum number of modules of a chain."""
    min_free_disk_bytes: int = Field(default=64 * MIB_BYTES, ge=0)
    """Free disk space below which uploads are refused."""
    read_seconds: PositiveFloat = 10.0
    """Maximum time to read an upload."""
    preview_seconds: PositiveFloat = 10.0
    """Maximum time to prepare a preview. On a busy machine, a preview may run until it has used
    this much processor time, but at most six times as long."""
    preview_search_seconds: PositiveFloat = 4.0
    """Maximum time of the search for a path in a preview. If this time is not enough, the preview
    shows no path and suggests changes. This time is part of `FOLDBACK_PREVIEW_SECONDS`."""
    files_waiting: Count = 8
    """Maximum number of exports and pictures that wait or are being created."""
    files_waiting_of_visitor: Count = 3
    """Maximum number of one visitor's exports and pictures that wait or are being created."""
    answers_waiting: Count = 12
    """Maximum number of large responses (frames, trajectories, torques of motors) that wait or
    are being computed."""
    answers_waiting_of_visitor: Count = 4
    """Maximum number of one visitor's large responses that wait or are being computed."""
    previews_waiting: Count = 8
    """Maximum number of waiting previews."""
    previews_waiting_of_visitor: Count = 3
    """Maximum number of waiting previews for one visitor."""
    retime_seconds: PositiveFloat = 60.0
    """Maximum time to compute a trajectory or a table of motors."""
    preview_keep_s: PositiveFloat = 86400.0
    """Time after which an unused preview is deleted."""
    previews_bytes: int = Field(default=512 * MIB_BYTES, ge=MIB_BYTES)
    """Maximum disk space for previews."""
    previews_of_visitor_bytes: int = Field(default=128 * MIB_BYTES, ge=MIB_BYTES)
    """Maximum disk space for one visitor's previews."""
    most_previews: Count = 10_000
    """Maximum number of stored previews."""
    most_previews_of_visitor: Count = 1_000
    """Maximum number of stored previews for one visitor."""
    stage_seconds: PositiveFloat = 1800.0
    """Maximum wall-clock time of one stage of a fold."""
    stage_cpu_seconds: PositiveFloat = 3600.0
    """Maximum processor time of a fold, for all its stages together. After a pause, the time counts
    from zero."""
    child_memory_bytes: int = Field(default=2048 * MIB_BYTES, ge=128 * MIB_BYTES)
    """Maximum memory of one computing process. Each fold has one such process;
    other processes read uploads, prepare previews, compute trajectories, and draw pictures and
    movies."""
    niceness: int | None = Field(default=None, ge=0, le=19)
    """`nice` value of computing processes; higher values leave more time for pages and for other
    programs. Default: 0 if the service listens on a loopback address, as on your own computer, 19
    otherwise. Set 19 for a public service behind a proxy."""

    movies_waiting: Count = 6
    """Maximum number of waiting movies."""
    movies_waiting_of_visitor: Count = 2
    """Maximum number of waiting movies for one visitor."""
    movies_of_fold: Count = 12
    """Maximum number of stored movies of one fold, counted separately for its owner and for all
    others. The oldest movies are deleted first."""
    movie_seconds: PositiveFloat = 600.0
    """Maximum time to create a movie."""

    max_streams: Count = 512
    """Maximum number of open event streams (`/events`)."""
    max_streams_of_visitor: Count = 16
    """Maximum number of open event streams of one visitor."""
    max_waits: Count = 512
    """Maximum number of requests that wait for frames (`?wait=`)."""
    max_waits_of_visitor: Count = 32
    """Maximum number of one visitor's requests that wait for frames."""
    max_target_streams: Count = 32
    """Maximum number of open target streams (`/play`)."""
    max_target_streams_of_visitor: Count = 8
    """Maximum number of open target streams of one visitor."""
    max_classes: Count = 32
    """Maximum number of classes: fold pages that a leader shows to followers with *Follow me*."""
    max_classes_of_visitor: Count = 4
    """Maximum number of classes that one visitor may lead."""
    max_followers: Count = 400
    """Maximum number of followers in all classes together."""
    max_followers_of_visitor: Count = 100
    """Maximum number of followers that share one visitor's address."""
    embed_origins: Names = ()
    """Sites that may embed folds, such as `https://…`, separated by commas; `*` allows all."""
    frames_per_answer: Count = 2000
    """Maximum number of frames in one response of the API."""
    numbers_per_answer: int = Field(default=2_000_000, ge=1000)
    """Maximum count of numbers in one response of the API."""

    @field_validator("log_format", "log_level", mode="before")
    @classmethod
    def _lower(cls, value: Any) -> Any:
        return value.lower() if isinstance(value, str) else value

    @field_validator("allowed_hosts", "embed_origins", "origins", "trusted_proxies", mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if value.lstrip().startswith("["):
            try:
                return json.loads(value)
            except ValueError:
                raise ValueError(f"got {value!r}, expected names separated by commas.") from None
        return tuple(name.strip() for name in value.split(",") if name.strip())

    @field_validator("origins", "embed_origins")
    @classmethod
    def _origins(cls, value: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        value = tuple(name.removesuffix("/") for name in value)  # as browsers send it
        for name in value:
            if name == "*" and info.field_name == "embed_origins":
                continue
            if not _is_origin(name):
                raise ValueError(
                    f"got {name!r}, expected a scheme and a host such as https://example.org, "
                    "without a path."
                )
        return value

    @field_validator("metrics_token")
    @classmethod
    def _token(cls, value: SecretStr | None) -> SecretStr | None:
        length = len(value.get_secret_value()) if value else 0
        if value and length < MIN_TOKEN_LENGTH:
            raise ValueError(
                f"got a token of {length} characters, expected {MIN_TOKEN_LENGTH} or more; create "
                "one with `openssl rand -hex 32`."
            )
        return value or None

    @field_validator("database_url")
    @classmethod
    def _url(cls, value: str | None) -> str | None:
        # The message does not quote the value, because it may contain a password.
        if value and not _is_database(value):
            raise ValueError(
                "got an unsupported address, expected an address like postgresql://user@host/name."
            )
        if value and value.startswith("postgres") and find_spec("psycopg") is None:
            raise ValueError(
                "got an address of PostgreSQL, for which a package is not installed; install it "
                "with pip install 'foldback[storage]'."
            )
        return value

    @field_validator("imprint_url")
    @classmethod
    def _web_address(cls, value: str | None) -> str | None:
        if value and not re.fullmatch(r"https?://[^\s\"'<>]+", value):
            raise ValueError(
                f"got {value!r}, expected an address like https://example.org/legal-notice."
            )
        return value or None

    @field_validator("trusted_proxies")
    @classmethod
    def _networks(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for name in value:
            try:
                ip_network(name, strict=False)
            except ValueError:
                raise ValueError(
                    f"got {name!r}, expected an address or a network such as 10.0.0.0/8."
                ) from None
        return value

    @cached_property
    def root(self) -> Path:
        """Absolute path of the data directory."""
        return self.data_dir.expanduser().resolve()

    @cached_property
    def read_only(self) -> bool:
        """True if the data directory exists and is read-only; checked only once."""
        places = (self.root, self.folds_dir, self.uploads_dir, self.root / "foldback.db")
        return any(refuses_writing(place) for place in places)

    @property
    def child_niceness(self) -> int:
        """Niceness (POSIX) of computing processes."""
        if self.niceness is not None:
            return self.niceness
        return 0 if is_loopback(self.host) else 19

    @property
    def folds_dir(self) -> Path:
        """Directory with a subdirectory for each fold."""
        return self.root / "folds"

    @property
    def uploads_dir(self) -> Path:
        """Directory for uploads until they are accepted."""
        return self.root / "uploads"

    @property
    def work_dir(self) -> Path:
        """Directory in which folds are computed if they are stored in an object store."""
        return self.root / "work"

    @property
    def cache_dir(self) -> Path:
        """Directory for local copies of files from the object store."""
        return self.root / "cache"

    @property
    def scratch_dir(self) -> Path:
        """Directory for unfinished files."""
        return self.root / "scratch"

    @property
    def motions_dir(self) -> Path:
        """Directory for retiming, the only one that the retiming process may access."""
        return self.root / "motions"

    @property
    def previews_dir(self) -> Path:
        """Directory for uploads under preview."""
        return self.root / "previews"

    @property
    def store_url(self) -> str:
        """URL of the database with the rows."""
        url = self.database_url or f"sqlite:///{self.root / 'foldback.db'}"
        for scheme in ("postgres://", "postgresql://"):
            if url.startswith(scheme):
                return f"postgresql+psycopg://{url.removeprefix(scheme)}"
        return url

    def make_directories(self) -> None:
        """Create missing directories, unless the disk is read-only."""
        if self.read_only:
            return
        for directory in (self.root, self.folds_dir, self.uploads_dir):
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        with suppress(OSError):  # it belongs to another user
            self.root.chmod(0o700)


def is_loopback(host: str) -> bool:
    """Return True if only programs of this machine can reach an address to listen on."""
    return host in LOOPBACK or host.startswith("127.")


def unknown_names(names: Iterable[str]) -> dict[str, str | None]:
    """Return names that resemble settings but are none, each with the most similar setting."""
    setting_names = [name.upper() for name in Settings.model_fields]
    variables: dict[str, str | None] = {}
    for name in sorted(names):
        setting_name = name.upper().removeprefix(VARIABLE_PREFIX)
        if name.upper().startswith(VARIABLE_PREFIX) and setting_name not in setting_names:
            nearest = get_close_matches(setting_name, setting_names, n=1)
            variables[name] = f"{VARIABLE_PREFIX}{nearest[0]}" if nearest else None
    return variables


def unknown_words(name: str, nearest: str | None) -> str:
    """Return the message about a variable that is not a setting."""
    return f"{name} is not a setting and is ignored" + (
        f"; did you mean {nearest}?" if nearest else ""
    )


def _is_origin(value: str) -> bool:
    try:
        address = urlsplit(value)
        _ = address.port
    except ValueError:
        return False
    return (
        bool(address.scheme and address.hostname)
        and not (address.path or address.query or address.fragment or "@" in address.netloc)
        and not any(letter.isspace() or letter in ";'\"" for letter in value)
    )


def _is_database(value: str) -> bool:
    # Imported only if needed: computing processes have no database.
    from sqlalchemy.engine import make_url
    from sqlalchemy.exc import ArgumentError

    try:
        url = make_url(value)
    except (ArgumentError, ValueError):
        return False
    return url.drivername.partition("+")[0] in ("sqlite", "postgres", "postgresql")
