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
from gateway.web import assets
from gateway.web.assets import build, first_modules
from release.vendored import FOLDER, component, faults, libraries
from tests.unit.report.synthetic import axis_material
from tests.unit.web.client import Client
from tests.unit.web.services import TOKEN, offered
from tests.unit.web.test_daemon import SITE

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "gateway" / "web" / "page"
BEARER = {"Authorization": f"Bearer {TOKEN}"}
LITERAL = re.compile(r"""\bt\(\s*(?:[^"`()]*\?\s)?"([a-z_]+\.[a-z_\-]+)"(?:\s+:\s"([a-z_]+\.[a-z_\-]+)")?""")
FOREIGN = re.compile(r"(?:src|href)=\"(?!/|\{page\})|https?://(?!www\.w3\.org)|innerHTML|eval\(| style=")
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
    files.append(ROOT / "gateway" / "cli" / "machine" / "doctor.py")
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
    served = Path(assets.__file__).read_text(encoding="utf-8")  # keys that stand for commands in the catalogue
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


def test_libraries_of_others_are_as_released_listed_and_named_among_the_licences() -> None:
    assert faults() == []
    page = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
    for one in libraries():
        assert f"| {one['name']} | {one['version']} | {one['licence']} |" in page
        assert component(one)["hashes"][0]["alg"] == "SHA-512"
        assert len(component(one)["hashes"][0]["content"]) == 128


def test_a_changed_or_unlisted_library_is_told(tmp_path: Path) -> None:
    for path in FOLDER.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "uPlot.min.css").write_text("body {}", encoding="ascii")
    (tmp_path / "other.js").write_text("", encoding="ascii")
    (tmp_path / "three.core.min.js").unlink()
    told = [one.split(":")[0] for one in faults(tmp_path)]
    assert told == ["other.js", "three.core.min.js", "uPlot.min.css"]


def test_no_module_of_the_page_imports_itself_over_others() -> None:
    imports = {
        path.name: set(re.findall(r'from "\./([a-z0-9]+\.js)"', path.read_text(encoding="utf-8")))
        for path in PAGE.glob("*.js")
    }
    while free := [name for name, of in imports.items() if not of & set(imports)]:
        for name in free:
            del imports[name]
    assert imports == {}, "what is left is a circle, or leads into one"


def test_files_of_the_page_are_small_local_and_without_inline_code() -> None:
    for path in PAGE.iterdir():
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 600
        assert [line for line in text.splitlines() if len(line) > 120] == [], path.name
        assert not FOREIGN.search(text), path.name


def test_every_file_that_the_page_names_is_served_with_a_policy_that_lets_nothing_else_run(tmp_path: Path) -> None:
    client = Client(offered(tmp_path, SITE).app)
    page = client.get("/")
    policy = page.headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    named = re.findall(r'"(/static/[^"]+\.(?:js|css))"', page.text)
    assert page.headers["cache-control"] == "no-cache"
    assert {name.rsplit("/", 1)[1] for name in named} >= {"base.css", *first_modules()}
    for path in named:
        answer = client.get(path)
        assert answer.status_code == 200, path
        assert answer.headers["content-type"].startswith(("text/css", "text/javascript"))
        assert "immutable" in answer.headers["cache-control"]
    at = f"/static/{build()}"
    for path in (
        f"{at}/page/..%2fapp.py",
        f"{at}/page/nothing.js",
        f"{at}/page/index.html",
        f"{at}/words/xx.json",
        f"{at}/other/base.css",
    ):
        assert client.get(path).status_code == 404
    old = client.get("/static/0123456789ab/page/base.css")
    assert (old.status_code, old.headers["cache-control"]) == (200, "no-cache"), "a page of another build is not kept"
    assert client.get("/healthz").headers["cache-control"] == "no-store"


def test_a_first_visit_takes_little_and_what_is_sent_is_compressed(tmp_path: Path) -> None:
    """Below 150 kB: page, styles, modules, the first chart and its words; the catalogue comes after them."""
    client = Client(offered(tmp_path, SITE).app, headers={"accept-encoding": "gzip"})
    at = f"/static/{build()}"
    first = re.findall(r'"(/static/[^"]+\.(?:js|css|svg))"', client.get("/").text)
    more = [f"{at}/words/en.json", f"{at}/vendor/uPlot.iife.min.js", f"{at}/vendor/uPlot.min.css"]
    answers = [client.get(path) for path in ("/", *dict.fromkeys(first), *more)]
    sent = sum(int(answer.headers["content-length"]) for answer in answers)
    assert sent < 150_000, sent
    assert all(
        answer.headers["content-encoding"] == "gzip" for answer in answers[2:] if "/static/icon" not in str(answer.url)
    )
    assert not any("three" in path for path in first), "a library of one tab is loaded with that tab"


@pytest.mark.parametrize("language", LANGUAGES)
def test_words_hold_the_page_every_code_and_the_terms(tmp_path: Path, language: str) -> None:
    client, at = Client(offered(tmp_path, SITE).app), f"/static/{build()}"
    words = client.get(f"{at}/words/{language}.json").json()
    codes = client.get(f"{at}/codes/{language}.json").json()
    assert set(codes) == set(catalogue())
    assert words["page"] == page_texts(language)
    assert "term_start" in words["terms"]
    assert codes["P-START"][2] == "ask"


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


def test_standards_over_one_another_span_what_they_call_accuracy(tmp_path: Path) -> None:
    """Each by its own figure: A, P, twice NMTBA's half width, the range of all readings; of B 6330 the first pass."""
    client, run, kept = _measured(tmp_path)
    at = f"/api/v1/sites/hall-3/runs/{run}"
    spans = {
        "ISO 230-2:2014": ("A", 1.0),
        "ISO 230-2:1988": ("A", 1.0),
        "VDI/DGQ 3441:1977": ("P", 1.0),
        "VDI/DGQ 3441:1977 range": ("P", 1.0),
        "NMTBA:1972": ("A_bi", 2.0),
        "ASME B5.54-1992": ("acc_bi", 1.0),
    }
    answer = client.get(f"{at}/bands/X1?phase=before&standards={','.join(spans)}").json()
    assert (answer["unit"], answer["targets"]) == ("um", kept.targets.tolist())
    for band in answer["bands"]:
        name, times = spans[band["standard"]]
        figures = client.get(f"{at}/figures/X1?phase=before&standard={band['standard']}").json()["rows"]
        value = next(one["value"] for one in figures if one["parameter"] == name)
        assert max(band["high"]) - min(band["low"]) == pytest.approx(times * value), band["standard"]
    first = client.get(f"{at}/bands/X1?phase=before&standards=JIS B 6330:1980").json()["bands"][0]
    readings = axis_material("X1", "mm").capture_before.deviations[:, 0]
    assert (first["low"], first["high"]) == (readings.min(axis=1).tolist(), readings.max(axis=1).tolist())
    assert client.get(f"{at}/bands/X1?standards=nothing").json()["code"] == "E-EVAL-STANDARD"


def test_air_and_material_are_there_over_the_command_and_over_a_stored_run(tmp_path: Path) -> None:
    client, run, _kept = _measured(tmp_path)
    assert client.get("/api/v1/sites/hall-3/air").json()[0]["air_degc"] == 20.4
    capture = axis_material("X1", "mm").capture_before
    found = client.get(f"/api/v1/sites/hall-3/runs/{run}/environment").json()
    wanted = [(capture.started_utc, capture.ambient_start), (capture.ended_utc, capture.ambient_end)]
    assert [(one["utc"], one["axis"], one["material_degc"]) for one in found] == [
        (utc, "X1", list(air.material_degc)) for utc, air in wanted
    ]
