"""The page renders a message as the program does: the same text, numbers and plurals in each language."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from drivers.message import Form, Message, Moment, Quantity, digits, fixed, render
from gateway.errors import VerifyError
from gateway.web.assets import codes, words

PAGE = Path(__file__).parents[3] / "gateway" / "web" / "page"
READS = Message.of("W-SWITCH-READS", switch=Message.of("W-SWITCH-ON"), acting=Quantity(0.25, "", 3, signed=True))
MESSAGES = (
    READS,
    Message.of("W-PUSH-AGAINST", count=1),
    Message.of("W-PUSH-AGAINST", count=12),
    Message.of("W-PUSH-REST-LOST", name="X1"),
    Message.of("S-FILE-LARGEST", value=Quantity(-0.35), unit="um"),
    Message.of("W-PUSH-STOP-BY", by=Message.of("W-PUSH-STOP-BY", by=("X1", Quantity(1.5, "um")))),
    Message.of("W-PUSH-STOP-BY", by=(READS, Message.of("W-PUSH-ALREADY"))),
    Message.of("W-VERDICT-FIGURES", figure="M", before=fixed(12.345), after=fixed(0.5), U=digits(0.1234), unit="um"),
    Message.of("W-PUSH-STOP-BY", by=Moment("2026-01-02T03:04:05+00:00")),
    Message("W-PUSH-STOP-BY", {"by": "a cancel"}, Form.REASON),
    VerifyError("E-PUSH-NOT-RESTORED", "X1", axis="X1", first=Message.of("W-PUSH-TWO-READS")).message,
    Message.of(
        "S-COMP-REASONS",
        reasons=(
            Message("S-COMP-WITHIN-U", {"bound": "0.5", "unit": "um"}, Form.ERROR, "X1"),
            Message("S-COMP-CROSS-ON", {"tables": "3"}, Form.ERROR, "X1"),
        ),
    ),
    Message.stored("the old table was put back"),
)
SCRIPT = """
globalThis.document = { documentElement: { lang: "en", dataset: {} } };
globalThis.localStorage = { getItem: () => null, setItem: () => undefined };
const { texts, language, messages } = JSON.parse(process.argv[2]);
globalThis.fetch = async (url) => {
  return { ok: true, json: async () => (String(url).includes("/codes/") ? texts.codes : texts) };
};
const words = await import(process.argv[1]);
await words.speak(language);
await new Promise((over) => setTimeout(over));
console.log(JSON.stringify(messages.map(words.message)));
"""


@pytest.mark.parametrize("language", ["en", "de", "zh"])
def test_the_page_renders_a_message_as_the_program_does(language: str, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("NOT RUN: this system has no node")
    for name in ("words.js", "figures.js", "api.js"):
        shutil.copy(PAGE / name, tmp_path / name)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    used = {code for one in MESSAGES for code in _codes(one.as_data())}
    texts = words(language) | {"codes": {code: text for code, text in codes(language).items() if code in used}}
    told = {"texts": texts, "language": language, "messages": [one.as_data() for one in MESSAGES]}
    done = subprocess.run(
        [node, "--input-type=module", "-e", SCRIPT, str(tmp_path / "words.js"), json.dumps(told)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    wanted = [re.sub(r"-(?=0[.,])", "−", render(one, language, plain=True)).replace(" -> ", " → ") for one in MESSAGES]
    assert json.loads(done.stdout) == wanted


def _codes(data: object) -> set[str]:
    if isinstance(data, dict):
        own = {str(data["code"])} if "code" in data else set()
        return own.union(*map(_codes, data.values()))
    return set().union(*map(_codes, data)) if isinstance(data, list) else set()


AT_WORK = """
globalThis.document = { documentElement: { lang: "en", dataset: {} } };
globalThis.localStorage = { getItem: () => null, setItem: () => undefined };
const [, page, texts, pictures] = process.argv;
const all = JSON.parse(texts);
globalThis.fetch = async (url) => {
  return { ok: true, json: async () => (String(url).includes("/codes/") ? all.codes : all) };
};
const { speak } = await import(`${page}/words.js`);
const { state } = await import(`${page}/state.js`);
const { sentence, writing } = await import(`${page}/sentence.js`);
await speak("en");
await new Promise((over) => setTimeout(over));
console.log(JSON.stringify(JSON.parse(pictures).map((status) => {
  Object.assign(state, { status, said: [{ code: "", words: "X1" }] });
  return [writing(), sentence().head];
})));
"""


@pytest.mark.parametrize(
    ("tables", "at_work"),
    [
        ([], False),
        ([["X1", "begun"]], True),
        ([["X1", "new"], ["C1", "writing"]], True),
        ([["X1", "on"]], True),
        ([["X1", "new"]], False),
        ([["X1", "unknown"]], False),
        ([["X1", "off"]], False),
    ],
)
def test_a_push_at_work_is_called_so_and_not_held(tmp_path: Path, tables: list[list[str]], at_work: bool) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("NOT RUN: this system has no node")
    for name in ("words.js", "figures.js", "api.js", "state.js", "sentence.js"):
        shutil.copy(PAGE / name, tmp_path / name)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    texts = words("en") | {"codes": {}}
    held = [{"loud": True, "code": "", "fields": {"phase": "still-on"}, "words": "X1 may be on", "back": []}]
    run = {"kind": "push", "tables": tables, "words": "push"}
    picture = {"run": run, "held": held, "left": [], "devices": [], "alarms": [], "last_runs": [], "trouble": None}
    told = [node, "--input-type=module", "-e", AT_WORK, str(tmp_path), json.dumps(texts), json.dumps([picture])]
    done = subprocess.run(told, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ((writes, head),) = json.loads(done.stdout)
    assert (writes, head.startswith("Push in progress")) == (at_work, at_work)
    assert at_work or "nobody stands for" in head
