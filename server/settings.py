"""What can be set from outside: environment variables ``FTLAB_*``, all with defaults that are safe on one machine."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Addresses that only this machine can reach."""

REPOSITORY = Path(__file__).resolve().parent.parent
"""FTLab runs from its checkout; the page is found beside the server."""


class UserError(Exception):
    """Something the person at the keyboard can put right; one line says how."""


class SettingsError(UserError):
    """A setting that cannot be taken."""


class Settings(BaseModel):
    """Everything the server can be told. Read once at the start, never changed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = Field(default="127.0.0.1", min_length=1, description="address to bind")
    port: int = Field(default=8000, ge=0, le=65535, description="port to bind; 0 takes a free one")
    token: str | None = Field(default=None, min_length=1, max_length=200, description="needed on any other address")
    allowed_hosts: tuple[str, ...] = Field(
        default=(), description="further names this server is reached by, as in the Host header: name or name:port"
    )
    max_experiments: int = Field(default=32, ge=1, le=10_000, description="live experiments at the same time")
    max_epochs: int = Field(default=20_000, ge=16, description="recorded epochs of an experiment before thinning")
    max_body_bytes: int = Field(default=4_000_000, ge=1_000, description="largest scenario document")
    max_observation_bytes: int = Field(
        default=64_000_000, ge=1_000, le=64_000_000, description="largest observation file of a receiver's log"
    )
    max_navigation_bytes: int = Field(
        default=20_000_000, ge=1_000, le=20_000_000, description="largest navigation file of a receiver's log"
    )
    max_log_epochs: int = Field(default=8_640, ge=1, le=8_640, description="epochs of the longest log")
    max_upload_bytes: int = Field(
        default=400_000_000, ge=1_000, description="all uploaded logs together; each goes with its last experiment"
    )
    max_advance_epochs: int = Field(default=1_000_000, ge=1, description="largest single advance")
    workers: int = Field(default=2, ge=1, le=64, description="threads that step experiments")
    sockets_per_client: int = Field(
        default=256, ge=1, description="streams and scenes open from one address at the same time"
    )
    streams_per_experiment: int = Field(default=32, ge=1, description="browsers watching one experiment")
    frontend: Path = Field(default=REPOSITORY / "frontend", description="folder of the page")

    @property
    def max_log_bytes(self) -> int:
        """Largest body of an upload: both files, and the form around them."""
        return self.max_observation_bytes + self.max_navigation_bytes + 64_000

    @field_validator("allowed_hosts", mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        return tuple(part.strip() for part in value.split(",") if part.strip()) if isinstance(value, str) else value

    @field_validator("frontend")
    @classmethod
    def _holds_the_page(cls, value: Path) -> Path:
        if not (value / "index.html").is_file():
            raise ValueError("a folder with the page's index.html is needed")
        return value

    @model_validator(mode="after")
    def _others_need_a_token(self) -> Self:
        if self.host not in LOOPBACK and self.token is None:
            raise ValueError(
                f"binding {self.host} lets other machines in, so it needs a token: set FTLAB_TOKEN, or bind 127.0.0.1"
            )
        return self

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None, **given: Any) -> Settings:
        """Settings from ``FTLAB_*`` (and ``PORT``), overridden by what is ``given`` and not None.

        Raises:
            SettingsError: a value that cannot be taken, with its name and what would be right, in one line.
        """
        environment = os.environ if environment is None else environment
        values: dict[str, Any] = {}
        if environment.get("PORT"):
            values["port"] = environment["PORT"]
        for name in cls.model_fields:
            if environment.get(f"FTLAB_{name.upper()}"):
                values[name] = environment[f"FTLAB_{name.upper()}"]
        values |= {name: value for name, value in given.items() if value is not None}
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise SettingsError("; ".join(_in_words(e) for e in error.errors(include_url=False))) from None


def _in_words(error: Any) -> str:
    message = error["msg"].removeprefix("Value error, ")
    if not error["loc"]:
        return str(message)
    shown = "" if error["loc"] == ("token",) else f", not {error['input']!r}"
    return f"{error['loc'][0]}: {message}{shown}"
