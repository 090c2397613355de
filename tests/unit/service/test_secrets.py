"""Twenty planted secrets: none in the bundle, the logs, the API, the pages, the figures, the audit log, errors."""

from __future__ import annotations

import io
import json
import logging
import zipfile
from pathlib import Path

import pytest

from gateway import audit
from gateway.broker.lending import NOTICE_FILE
from gateway.cli.service import make_bundle
from gateway.config import SiteFile, load_site
from gateway.daemon.service_manager import JournalForm, log_into
from gateway.store import Store
from gateway.store.log_book import LogBook
from tests.unit.audit.log import Moments
from tests.unit.web.client import Client
from tests.unit.web.services import Offered, offered
from tests.unit.web.test_doors import FILL, _every

EXAMPLE = Path(__file__).parents[3] / "examples" / "sites" / "opcua-grinder.toml"
PLANTED = {
    name: f"planted{number:02d}{name.replace('-', '').upper()}q"
    for number, name in enumerate(
        (
            "control-password",
            "mqtt-password",
            "index-password",
            "comment-password",
            "comment-address",
            "terminal-token",
            "first-start-token",
            "broker-token",
            "account-password",
            "wrong-password",
            "program-token",
            "session-key",
            "csrf-key",
            "tls-key",
            "client-key",
            "log-password",
            "log-address",
            "error-token",
            "trace-password",
            "run-site-password",
        )
    )
}


def planted_site(folder: Path) -> Path:
    """A site whose files, comments and runs hold secrets."""
    path = folder / "site.toml"
    text = EXAMPLE.read_text(encoding="utf-8")
    head = f'# password = "{PLANTED["comment-password"]}" at tcp://eve:{PLANTED["comment-address"]}@10.0.0.1:1\n'
    more = (
        '\n[service]\nindex_url_file = "index.url"\ncertificate = "gateway.pem"\nkey = "gateway.key"\n'
        '[service.mqtt]\nhost = "127.0.0.1"\npassword_file = "mqtt.word"\n'
    )
    path.write_text(head + text + more, encoding="utf-8")
    (folder / "password.txt").write_text(PLANTED["control-password"] + "\n")
    (folder / "mqtt.word").write_text(PLANTED["mqtt-password"])
    (folder / "index.url").write_text(f"postgresql+psycopg://u:{PLANTED['index-password']}@127.0.0.1:1/x\n")
    for name, file in (("tls-key", "gateway.key"), ("client-key", "client.key")):
        pem = f"-----BEGIN PRIVATE KEY-----\n{PLANTED[name]}\n-----END PRIVATE KEY-----\n"
        (folder / file).write_text(pem)
    return path


def planted_store(root: Path) -> Store:
    """A store whose own files, logs and newest run hold secrets."""
    store = Store(root)
    run = store.create("hall-3")
    (root / "daemon.token").write_text(PLANTED["terminal-token"] + "\n")
    (root / NOTICE_FILE).write_text(json.dumps({"pid": 1, "port": 1, "token": PLANTED["broker-token"]}))
    (root / "service").mkdir()
    (root / "service" / "first-start.token").write_text(PLANTED["first-start-token"] + "\n")
    (run.path / "site.toml").write_text(f'password = "{PLANTED["run-site-password"]}"\n')
    (run.path / "laser.trace").write_bytes(b"{}\n<12345678" + PLANTED["control-password"].encode())
    said = json.dumps({"password": PLANTED["trace-password"], "key": PLANTED["client-key"]})
    pem = f"-----BEGIN PRIVATE KEY-----\\n{PLANTED['client-key']}\\n-----END PRIVATE KEY-----"
    (run.path / "sent-note.txt").write_text(said.replace(PLANTED["client-key"], pem))
    return store


def test_there_are_twenty() -> None:
    assert len(set(PLANTED.values())) == 20


def leaks(text: str) -> list[str]:
    return [name for name, value in PLANTED.items() if value in text]


@pytest.fixture
def planted(tmp_path: Path) -> tuple[SiteFile, Path, Store]:
    path = planted_site(tmp_path)
    return load_site(path), path, planted_store(tmp_path / "runs")


def spoken(store: Store, capsys: pytest.CaptureFixture[str]) -> None:
    """What a careless program says of its secrets, into log and journal."""
    handler = logging.StreamHandler()
    handler.setFormatter(JournalForm({"JOURNAL_STREAM": "1:1"}))
    log = logging.getLogger("trueflank.test")
    log.addHandler(handler)
    with log_into(LogBook(store.root, Moments().utc)):
        try:
            raise OSError(f"refused: token = {PLANTED['error-token']}")
        except OSError:
            log.exception("at mqtt://u:%s@hall, password=%s", PLANTED["log-address"], PLANTED["log-password"])
    log.removeHandler(handler)
    assert leaks(capsys.readouterr().err) == []


def test_no_planted_secret_leaves_the_house(
    planted: tuple[SiteFile, Path, Store], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site, path, store = planted
    spoken(store, capsys)
    offer = served(site, store.root)
    told = asked(offer)
    assert len(told) > 80
    for where, text in told.items():
        assert leaks(text) == [], where
    for found in (*(store.root / "audit").glob("*"), *(store.root / "logs").glob("*")):
        assert leaks(found.read_text(encoding="utf-8")) == [], found.name
    kept = (store.root / "service" / "users.json").read_text(encoding="utf-8")
    assert leaks(kept) == []
    data = make_bundle(site, path, store, runs=5, doctor={"error": f"password: {PLANTED['control-password']}"})
    with zipfile.ZipFile(io.BytesIO(data)) as found_zip:
        members = {name: found_zip.read(name).decode("utf-8", "replace") for name in found_zip.namelist()}
    kinds = {"site-as-read.json", "versions.json", "doctor.json", "audit.json", "contents.txt", "logs/trueflank.log"}
    assert kinds | {"sites/site.toml"} <= set(members)
    assert {name.rsplit("/", 1)[-1] for name in members} >= {"run.json", "laser.trace", "sent-note.txt"}
    for name, text in members.items():
        assert leaks(text) == [], name
        assert "argon2" not in text or name == "versions.json", name


def served(site: SiteFile, root: Path) -> Offered:
    """The site behind the routes, with an account, a program and a session that bear planted secrets."""
    offer = offered(root, site.model_copy(update={"site": site.site.model_copy(update={"name": "hall-3"})}))
    accounts = offer.service.doors.accounts
    accounts.put("anna", ("viewer", "operator", "approver", "service"), password=PLANTED["account-password"])

    def note(action: str, *, actor: str = "", details: dict[str, object] | None = None) -> str:
        return audit.note(root, action, clock=Moments(), actor=actor, role="service", details=details)

    object.__setattr__(offer.service, "note", note)
    return offer


def asked(offer: Offered) -> dict[str, str]:
    """Every answer of every route: to nobody, to a stranger's secrets, to who may, to bodies that do not fit."""
    client, app = Client(offer.app), offer.app
    body = {
        "name": "anna",
        "password": PLANTED["wrong-password"],
        "pin": PLANTED["program-token"],
        "token": PLANTED["error-token"],
        "more": PLANTED["session-key"],
    }
    stranger = {
        "Authorization": f"Bearer {PLANTED['program-token']}",
        "cookie": f"trueflank-session={PLANTED['session-key']}",
        "x-csrf-token": PLANTED["csrf-key"],
    }
    signed = client.post("/api/v1/login", json={"name": "anna", "password": PLANTED["account-password"]})
    assert signed.status_code == 200
    mine = offer.signed_in("viewer", "operator", "approver", "service")
    run = offer.at.store.runs()[-1].run_id
    found = {"login": signed.text, "page": client.get("/", headers=mine).text}
    for path, method, _doors in _every(app):
        # A run's own files are shown as they were stored: what may stand in them is settled when they are written.
        where = path.format(**{**FILL, "run": run, "name": "run.json"})
        for who, headers in (("stranger", stranger), ("mine", mine), ("nobody", {})):
            answer = Client(app, headers=headers).request(method, where, json=body)
            found[f"{method} {where} {who}"] = f"{answer.text} {dict(answer.headers)}"
    return found
