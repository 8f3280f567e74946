"""The page on a law of one's own: its commands print what it shows, after its edits."""

import re
from pathlib import Path

import pytest

from marsedl import cli

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "examples" / "arena_law.md"
STEP = re.compile(r"(?ms)^```(bash|diff)\n(.*?)^```\n(?:```text\n(.*?)^```\n)?")


def edited(text, change):
    """A text after a change: lines that begin with - are those of it that become those with +."""
    old, new = ("\n".join(line[1:] for line in change.splitlines() if line[0] in kept) for kept in (" -", " +"))
    old, new = (f"{part}\n" if change.splitlines()[-1][-1] not in "#," else part for part in (old, new))
    assert text.count(old) == 1, change
    return text.replace(old, new)


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with the project's inputs, where the page may write; numerics are up already."""
    for name in ("configs", "data"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "Snakefile").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("marsedl.replication.pipeline.numerics.pin_numerics", lambda root: None)
    return tmp_path


def test_the_page_prints_what_it_shows(project, capsys):
    printed = []
    for language, text, _ in STEP.findall(PAGE.read_text(encoding="utf-8")):
        law = project / "my_law.py"
        if language == "diff":
            law.write_text(edited(law.read_text(encoding="utf-8"), text), encoding="utf-8")
            continue
        assert cli.main(text.split()[1:]) == 0
        lines = capsys.readouterr().out.splitlines()
        printed.append("\n".join(line for line in lines if "did not become vector code" not in line) + "\n")
    shown = [text for language, _, text in STEP.findall(PAGE.read_text(encoding="utf-8")) if language == "bash"]
    assert "====\n".join(printed) == "====\n".join(shown)
