"""The site file's section about the service: names, certificate, sign-out, index, watched folder."""

from __future__ import annotations

import re
from ipaddress import ip_address
from pathlib import Path

from pydantic import Field, field_validator, model_validator

from drivers.errors import words
from gateway.siteplan import Number, Section, Whole

_HOST = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9.-]{0,251}[A-Za-z0-9])?|\[[0-9A-Fa-f:]+\]")


class MqttSection(Section):
    """Messages for other systems by MQTT; the service publishes only and subscribes to nothing."""

    host: str = Field(min_length=1, max_length=253, description="name or address of the server of messages")
    port: Whole = Field(default=1883, ge=1, le=65535, description="its port; 8883 is usual with TLS")
    user: str = Field(default="", max_length=100, description="name to sign in with")
    password_file: Path | None = Field(default=None, description="file with the password, relative to the site file")
    password_env: str = Field(default="", max_length=100, description="environment variable with the password instead")
    ca: Path | None = Field(
        default=None, description="certificate (PEM) that the server's is signed by, relative to the site file: TLS"
    )
    prefix: str = Field(
        default="trueflank",
        pattern=r"^[A-Za-z0-9_.-]{1,60}(/[A-Za-z0-9_.-]{1,60}){0,5}$",
        description="first of topics",
    )
    queue_mb: Whole = Field(
        default=64, ge=1, le=4096, description="MB of messages that wait on the disk while the server is away"
    )

    @field_validator("host")
    @classmethod
    def _plain_host(cls, host: str) -> str:
        if _HOST.fullmatch(host) is None:
            raise ValueError(words("W-CFG-HOSTNAME", host=host))
        return host

    @model_validator(mode="after")
    def _one_password(self) -> MqttSection:
        if self.password_file is not None and self.password_env:
            raise ValueError(words("W-CFG-PAIR-NOT", one="password_file", other="password_env"))
        return self


class ServiceSection(Section):
    """The service (`trueflank serve`): its addresses, the duration of a sign-in, its watched folder."""

    hosts: tuple[str, ...] = Field(
        default=(), max_length=20, description="host names of the pages, in addition to this computer's own"
    )
    certificate: Path | None = Field(
        default=None, description="TLS certificate (PEM), relative to the site file; needed beyond this computer"
    )
    key: Path | None = Field(default=None, description="its private key (PEM), for its owner alone")
    proxies: tuple[str, ...] = Field(
        default=(), max_length=8, description="addresses of reverse proxies that end TLS and say who asks through them"
    )
    signout_min: Number = Field(default=15.0, ge=1, le=720.0, description="minutes without a request that sign out")
    leaked_passwords: Path | None = Field(
        default=None,
        description="list of leaked passwords that nobody may choose: SHA-1 hashes, sorted or in a folder by prefix",
    )
    index_url_file: Path | None = Field(
        default=None, description="file with the address of a database for many gateways; else one with the runs"
    )
    due_days: Whole = Field(default=365, ge=1, le=3650, description="days after which an axis is to be measured again")
    watch: Path | None = Field(
        default=None, description="folder whose new result files become runs, relative to the site file"
    )

    syslog: str = Field(
        default="",
        max_length=300,
        pattern=r"^$|^(udp|tcp)://[A-Za-z0-9.-]{1,253}(:[0-9]{1,5})?$",
        description="server of logs for sign-ins and audit records (RFC 5424): udp://HOST:514 or tcp://HOST:514",
    )
    mqtt: MqttSection | None = Field(default=None, description="server of messages that other systems listen to")

    @field_validator("hosts")
    @classmethod
    def _plain_names(cls, hosts: tuple[str, ...]) -> tuple[str, ...]:
        for host in hosts:
            if _HOST.fullmatch(host) is None:
                raise ValueError(words("W-CFG-HOSTNAME", host=host))
        return hosts

    @field_validator("proxies")
    @classmethod
    def _addresses(cls, proxies: tuple[str, ...]) -> tuple[str, ...]:
        for proxy in proxies:
            try:
                ip_address(proxy)
            except ValueError as error:
                raise ValueError(words("W-CFG-PROXY-ADDRESS", address=proxy)) from error
        return proxies

    @model_validator(mode="after")
    def _both(self) -> ServiceSection:
        if (self.certificate is None) != (self.key is None):
            raise ValueError(words("W-CFG-PAIR", one="certificate", other="key"))
        return self
