"""The operator's page as it is shipped: its files, its words in every language, and figures that equal the record's."""

from __future__ import annotations

import re
import string
from pathlib import Path
from typing import Any, get_args

import pytest

from drivers.errors import catalogue
from drivers.languages import LANGUAGES, page_texts
from gateway.push.state import Outcome
from gateway.store import Store
from gateway.web import showing
from tests.unit.report.synthetic import axis_material
from tests.unit.web.client import Client
from tests.unit.web.services import TOKEN, offered
from tests.unit.web.test_daemon import SITE

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "gateway" / "web" / "page"
BEARER = {"Authorization": f"Bearer {TOKEN}"}
LITERAL = re.compile(r"""\bt\(\s*(?:[^"`()]*\? )?"([a-z_]+\.[a-z_\-]+)"(?: : "([a-z_]+\.[a-z_\-]+)")?""")
FOREIGN = re.compile(r"(?:src|href)=\"(?!/)|https?://(?!www\.w3\.org)|innerHTML|eval\(| style=")
MADE = re.compile(r"""t\(`([a-z_]+)\.([a-z_]*)\$\{""")


def _scripts() -> str:
    return "\n".join(path.read_text(encoding="utf-8") for path in sorted(PAGE.glob("*.js")))


def _fields(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_language_has_every_sentence_with_the_same_fields(language: str) -> None:
    english, own = page_texts("en"), page_texts(language)
    assert set(own) == set(english)
    assert [key for key, text in own.items() if not text.strip() or _fields(text) != _fields(english[key])] == []


@pytest.mark.parametrize("language", [one for one in LANGUAGES if one != "en"])
def test_a_translated_code_is_one_that_exists_and_has_its_fields(language: str) -> None:
    english = catalogue()
    for code, entry in catalogue(language).items():
        assert {part: _fields(text) for part, text in entry.items()} == {
            part: _fields(text) for part, text in english[code].items()
        }, code


def test_a_german_um_behind_a_field_is_a_unit() -> None:
    """The page writes it as one: "Achse X1 um 3" would be read as micrometres."""
    texts = {code: " ".join(entry.values()) for code, entry in catalogue("de").items()}
    assert [code for code, text in texts.items() if re.search(r"[})\d>] um (?:\{|[0-9])", text)] == []


def test_every_end_of_a_push_has_its_words_in_every_language() -> None:
    ends = {f"ended.{one}" for one in get_args(Outcome)}
    for language in LANGUAGES:
        assert {key for key in page_texts(language) if key.startswith("ended.")} == ends


@pytest.mark.parametrize("language", [one for one in LANGUAGES if one != "en"])
def test_every_code_is_told_in_every_language(language: str) -> None:
    """No code is left out: what only a terminal says today may stand on the page tomorrow."""
    assert set(catalogue()) - set(catalogue(language)) == set()


def _checks() -> set[str]:
    """What each line of a doctor is called, by its source; an axis' own name stands for itself."""
    made = re.compile(r"""\b(?:fine|wrong|unknown|failed)\(\s*(?:"[A-Z-]+"|error|one\.code),\s*"([^"]+)\"""")
    named = ("doctor.py", "device.py", "control_checks.py")
    files = [path for name in named for path in (ROOT / "drivers").glob(f"*/**/{name}")]
    files.append(ROOT / "gateway" / "cli" / "control" / "connecting.py")
    return {name for path in files for name in made.findall(path.read_text(encoding="utf-8"))}


def test_every_state_of_a_run_has_its_word_on_the_page() -> None:
    files = (ROOT / "gateway" / "workflow").glob("**/*.py")
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    found = set(re.findall(r"""set_state\("([a-z-]+)\"""", text))
    assert len(found) > 8
    assert {f"runstate.{one}" for one in found} - set(page_texts("en")) == set()


def test_every_check_of_the_doctor_has_a_name_on_the_page() -> None:
    found = _checks()
    assert len(found) > 25
    assert {re.sub("[ -]", "_", f"check.{name.lower()}") for name in found} - set(page_texts("en")) == set()


def test_every_sentence_that_a_script_asks_for_is_there_and_none_is_left_over() -> None:
    script, known = _scripts(), set(page_texts("en"))
    asked = {key for pair in LITERAL.findall(script) for key in pair if key}
    made = MADE.findall(script)
    served = Path(showing.__file__).read_text(encoding="utf-8")  # keys that stand for commands in the catalogue
    quoted = {key for key in known if f'"{key}"' in script + served}
    assert len(asked) > 100
    assert asked - known == set()
    begins = tuple(f"{room}.{start}" for room, start in made)
    assert {key for key in known - quoted if not key.startswith(begins)} == set()


@pytest.mark.parametrize("path", sorted(PAGE.glob("*.js")), ids=lambda path: path.name)
def test_no_script_declares_a_name_twice(path: Path) -> None:
    """Two changes that merge without a conflict may do so; then the whole page stays empty."""
    text = path.read_text(encoding="utf-8")
    names = re.findall(r"^(?:export )?(?:async )?(?:const|let|function|class) (\w+)", text, re.MULTILINE)
    names += [one for group in re.findall(r"^import \{([^}]*)\}", text, re.MULTILINE) for one in _imported(group)]
    assert sorted(names) == sorted(set(names))


def _imported(group: str) -> list[str]:
    return [part.split(" as ")[-1].strip() for part in group.split(",") if part.strip()]


def test_files_of_the_page_are_small_local_and_without_inline_code() -> None:
    for path in PAGE.iterdir():
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 300
        assert not re.search(r"(?:src|href)=\"(?!/)|https?://(?!www\.w3\.org)|innerHTML|eval\(| style=", text), (
            path.name
        )


def test_every_file_that_the_page_names_is_served_with_a_policy_that_lets_nothing_else_run(tmp_path: Path) -> None:
    client = Client(offered(tmp_path, SITE).app)
    page = client.get("/")
    policy = page.headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    named = re.findall(r'"(/static/page/[^"]+)"', page.text)
    imported = {f"/static/page/{name}" for name in re.findall(r'from "\./([a-z]+\.js)"', _scripts())}
    assert len(named) >= 4
    for path in {*named, *imported}:
        answer = client.get(path)
        assert answer.status_code == 200, path
        assert answer.headers["content-type"].startswith(("text/css", "text/javascript"))
    for path in (
        "/static/page/..%2fapp.py",
        "/static/page/nothing.js",
        "/static/page/index.html",
        "/static/words/xx.json",
    ):
        assert client.get(path).status_code == 404


@pytest.mark.parametrize("language", LANGUAGES)
def test_words_hold_the_page_every_code_and_the_terms(tmp_path: Path, language: str) -> None:
    words = Client(offered(tmp_path, SITE).app).get(f"/static/words/{language}.json").json()
    assert set(words["codes"]) == set(catalogue())
    assert words["page"] == page_texts(language)
    assert "term_start" in words["terms"]
    assert words["codes"]["P-START"][2] == "ask"


def _measured(folder: Path) -> tuple[Client, str, Any]:
    offer = offered(folder, SITE)
    material = axis_material("X1", "mm")
    run = Store(folder).create("hall-3")
    run.put("capture-X1-before", material.capture_before)
    run.put("evaluation-X1-before", material.before)
    return Client(offer.app, headers=BEARER), run.run_id, material.before


def test_figures_are_the_records_and_are_judged_with_their_u(tmp_path: Path) -> None:
    client, run, kept = _measured(tmp_path)
    limits = f"E:{kept.E + 2 * kept.U['E']},A:{kept.A / 2}"
    answer = client.get(f"/api/v1/sites/hall-3/runs/{run}/figures/X1?phase=before&limits={limits}").json()
    rows = {one["parameter"]: one for one in answer["rows"]}
    assert {name: one["value"] for name, one in rows.items()} == {name: getattr(kept, name) for name in kept.U}
    assert rows["E"]["verdict"] == "pass"
    assert rows["A"]["verdict"] == "fail"
    assert "verdict" not in rows["R"]
    assert client.get(f"/api/v1/sites/hall-3/runs/{run}/figures/X1?limits=E:x").status_code == 422
    assert client.get(f"/api/v1/sites/hall-3/runs/{run}/figures/Y9").status_code == 404


def test_readings_so_far_and_approvals_are_asked_for(tmp_path: Path) -> None:
    client, run, _kept = _measured(tmp_path)
    assert client.get("/api/v1/sites/hall-3/taken").json()[0]["deviation"] == 0.5
    assert client.get(f"/api/v1/sites/hall-3/runs/{run}/approvals").json() == []
    assert client.get("/api/v1/standards").json()[0]["name"] == "ISO 230-2:2014"
