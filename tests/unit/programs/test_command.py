"""`trueflank check programs`: files to be read before the first day, and none lost."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError
from gateway.cli import app
from tests.unit.programs.sites import site_file


def run(*given: object) -> str:
    result = CliRunner().invoke(app, ["check", "programs", *map(str, given)], catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def test_every_program_says_what_it_is_and_moves_and_what_to_do_when_it_stops(tmp_path: Path) -> None:
    folder, site = tmp_path / "out", site_file(tmp_path, "demo")
    told = json.loads(run(site, "-o", folder, "--what", "load", "--json"))
    assert sorted(told["programs"]) == sorted(path.name for path in folder.iterdir())
    text = (folder / "load-axis-TFPUSH_X1.MPF").read_text()
    head = text[: text.index("DEF INT")]
    assert all(line.startswith("; ") for line in head.splitlines())
    said = " ".join(line.lstrip("; ") for line in head.splitlines())
    assert "_N_TFPUSH_X1_MPF: load and, after the release, enable X1(X1) (41 points), Z1(Z1) (31 points)" in said
    assert "machine YK7350B-0042" in said
    assert "Switching a table off or on moves its axis (X1, Z1, C1) by the table's value." in said
    assert "run " not in head
    assert "number " not in head
    assert "$AA_ENC_COMP" in said
    assert "R parameters: R80, R82, R85 to R90, R93 to R95." in said
    assert "If it stops: press RESET and grind nothing" in said
    assert "; ---- new table" in text


def test_every_program_is_written_where_one_does_not_hold_all_plans(tmp_path: Path) -> None:
    site = site_file(tmp_path, "zero", plan=False)
    text = site.read_text()
    secured = 'settings = { security = "None"'
    assert secured in text
    site.write_text(text.replace(secured, f"{secured}, plans_per_program = 2", 1))
    names = json.loads(run(site, "-o", tmp_path / "two", "--what", "measure", "--json"))["programs"]
    site.write_text(text)
    whole = json.loads(run(site, "-o", tmp_path / "one", "--what", "measure", "--json"))["programs"]

    def plans(folder: str, wanted: list[str]) -> list[str]:
        """What the operator is asked for and every target, in the order of the programs."""
        texts = [(tmp_path / folder / name).read_text() for name in wanted]
        return [line for one in texts for line in one.splitlines() if line.startswith(("MSG", "UTARGET[", "UFROM["))]

    assert len(set(names)) == len(names) > len(whole)
    assert plans("two", names) == plans("one", whole)
    heads = [(tmp_path / "two" / name).read_text().partition("DEF")[0] for name in names]
    assert any("in 2 parts" in " ".join(head.split()) for head in heads)
    assert not any(f"in {count} parts" in " ".join(head.split()) for head in heads for count in range(3, 40))


def test_a_file_that_is_there_stays_unless_forced(tmp_path: Path) -> None:
    folder, site = tmp_path / "out", site_file(tmp_path, "zero", plan=False)
    run(site, "-o", folder, "--what", "off")
    mine = folder / "off-X-TFOFF_X1.MPF"
    mine.write_text("signed")
    with pytest.raises(ConfigError, match="E-PROGRAM-THERE"):
        run(site, "-o", folder, "--what", "off")
    assert mine.read_text() == "signed"
    run(site, "-o", folder, "--what", "off", "--force")
    assert mine.read_text() != "signed"
    with pytest.raises(ConfigError, match="E-PROGRAM-WHAT"):
        run(site, "-o", folder, "--what", "everything")
