"""Foreign files that would take a core, the memory or minutes: refused by their size, their lines, or by a limit."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import FileFormatError
from drivers.local.textfile import LONGEST_LINE, MOST_KEYS, MOST_LINES, MOST_PARTS, bear, decode_text, parse_toml
from gateway.cli import app
from gateway.watch.bounded_process import run_bounded
from gateway.watch.watcher import LARGEST_BYTES, Folder, SeenFile, Watcher, WatchJournal


def endless() -> str:
    """Never comes to an end."""
    while True:
        pass


def greedy() -> str:
    """More memory than anybody may have."""
    return str(len(bytearray(64 << 30)))


def refusing(word: str) -> str:
    """A refusal of ours."""
    raise FileFormatError("E-FILE-EMPTY", word, bytes=0)


def test_work_apart_gives_its_answer_or_our_own_refusal_and_is_ended_at_its_limits() -> None:
    assert run_bounded(partial(str.upper, "abc"), where="x") == "ABC"
    with pytest.raises(FileFormatError) as caught:
        run_bounded(partial(refusing, "y.csv"), where="x")
    assert (caught.value.code, caught.value.where) == ("E-FILE-EMPTY", "y.csv")
    for work, bounds in ((endless, {"cpu_s": 1}), (greedy, {"memory_mb": 1024})):
        with pytest.raises(FileFormatError) as caught:
            run_bounded(work, where="x.csv", **bounds)
        assert (caught.value.code, caught.value.where) == ("E-WATCH-LIMIT", "x.csv")


def test_a_large_file_is_not_even_hashed_and_small_ones_come_first(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    with (folder / "a.csv").open("wb") as file:
        file.truncate(LARGEST_BYTES + 1)  # sparse: it takes no room
    (folder / "b.csv").write_bytes(b"b" * 2000)
    (folder / "c.csv").write_bytes(b"c")
    hashed, said = list[str](), list[tuple[str, str]]()

    class Noting(Folder):
        def digest(self, seen: SeenFile) -> str:
            hashed.append(seen.name)
            return super().digest(seen)

    def take(path: Path, _digest: str) -> str:
        return path.name

    def say(code: str, **fields: object) -> None:
        said.append((code, str(fields.get("why", ""))[:13]))

    watcher = Watcher(Noting(folder), WatchJournal(tmp_path), take, {".csv"}, settle_s=0.0, say=say)
    assert watcher.look(0.0) + watcher.look(1.0) == 2
    assert hashed == ["c.csv", "b.csv"]
    assert [one for one in said if one[1]] == [("P-WATCH-FAILED", "E-WATCH-LARGE")]
    assert watcher.waiting == 0


@pytest.mark.parametrize("data", [b"1," * LONGEST_LINE, b"a: 1\n" * (MOST_LINES + 1), b"a\r" * (MOST_LINES + 1)])
def test_lines_that_nobodys_software_writes_are_refused_before_they_are_looked_into(data: bytes) -> None:
    with pytest.raises(FileFormatError) as caught:
        decode_text(data, "cp1252", "x.csv")
    assert caught.value.code == "E-FILE-LINES"


def test_many_keys_and_keys_of_many_parts_are_refused_before_they_are_judged(tmp_path: Path) -> None:
    texts = {
        "keys": "".join(f"k{one}=1\n" for one in range(100_000)),
        "inline": "a = {" + ", ".join(f"k{one} = 1" for one in range(MOST_KEYS + 1)) + "}\n",
        "heads": "".join(f"[t{one}]\n" for one in range(90_000)),
        "parts": ".".join(["a"] * 50_000) + " = 1\n",
        "head": "[" + ".".join(["a"] * 50_000) + "]\n",
    }
    for name, text in texts.items():
        path = tmp_path / f"{name}.toml"
        path.write_text(text, encoding="ascii")
        result = CliRunner().invoke(app, ["check", str(path)])
        assert result.exit_code != 0
        said = f"{result.output} {result.exception}"
        assert "E-CFG-TOML" in said
        assert str(MOST_PARTS if name in ("parts", "head") else MOST_KEYS) in said.replace(",", "").replace(" ", "")
        with pytest.raises(ValueError, match="more than"):
            parse_toml(text)
    bear("targets = [" + ", ".join(["0.125"] * 4000) + "]\n" + "  1.5, 2.5,\n" * 4000 + "# =====\n" * 4000)
