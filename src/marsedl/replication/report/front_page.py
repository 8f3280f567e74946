"""What the README and the badge say of the papers and of words: written from the verdicts, never typed."""

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from marsedl.replication.claims.claim import NUMBERS, STANDING_VERDICTS, STATEMENTS, Claim
from marsedl.replication.claims.committed import committed_verdicts
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.rows import summary
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import Paper

WORDS = Path(__file__).with_name("words.yaml")
README, BADGE = Path("README.md"), Path("docs/images/badge.svg")
_BLOCK = re.compile(r"(?ms)^(<!-- (answers|words): written by `marsedl readme` -->\n).*?^(<!-- end -->)$")
_COUNTS = re.compile(r"\d+ of \d+ printed numbers; \d+ of \d+ statements")


class CommittedClaim(NamedTuple):
    """A claim with its committed verdict, None if none is committed; `summary` counts them like claims of a build."""

    kind: str
    verdict: str | None
    headline: int | None


def words() -> dict[str, str]:
    """Return the few words that report and README define before they use them; backticks in their meanings mark code.

    Raises InputError if `words.yaml` is malformed.
    """
    return {word: " ".join(text.split()) for word, text in read_yaml(WORDS).items()}


def badge(rows: Iterable[Claim | CommittedClaim]) -> dict[str, Any]:
    """Count the verdicts on all papers' claims in one line, in the schema of shields.io's endpoint badges.

    The colour says nothing: a claim that fails speaks of a paper, not of
    its replication.
    """
    counts = summary(rows)
    numbers, statements = counts[NUMBERS], counts[STATEMENTS]
    message = (
        f"{numbers['reproduced']} of {sum(numbers.values())} printed numbers; "
        f"{statements['holds']} of {sum(statements.values())} statements"
    )
    return {"schemaVersion": 1, "label": "replication", "message": message, "color": "blue"}


def write_badge(rows: Iterable[Claim], path: str | Path) -> None:
    """Write the badge of some claims as JSON; arguments as for `badge`, and the file."""
    write_text(path, json.dumps(badge(rows), indent=2) + "\n")


def committed_claims(root: Path, slug: str) -> list[CommittedClaim]:
    """Return the claims of a paper with their committed verdicts, in the printed order."""
    verdicts = committed_verdicts(root, slug)
    return [
        CommittedClaim(claim.kind, verdicts.get(claim.id, {}).get(CORRECTED), claim.headline)
        for claim in load_published(root / "data" / "published" / f"{slug}.yaml")
    ]


def answer(paper: Paper, rows: Sequence[CommittedClaim]) -> str:
    """Return what came out of one paper, as an item of a list in Markdown.

    paper: its catalogue, with the numbers of its texts. rows: its claims.
    """
    headline = [row.verdict for row in rows if row.headline is not None]
    numbers = summary(rows)[NUMBERS]
    standing = sum(verdict in STANDING_VERDICTS for verdict in headline)
    counts = (
        f"**{standing} of {len(headline)}** headline claims stand; "
        f"{numbers['reproduced']} of {sum(numbers.values())} printed numbers reproduce."
    )
    name = f"**[{paper.slug}](docs/papers/{paper.slug}.md)** ({paper.authors})."
    return " ".join(filter(None, [f"- {name}", paper.question or f"{paper.title}.", *paper.in_short[:1], counts]))


def filled(text: str, root: Path, papers: Iterable[Paper]) -> str:
    """Return the text of the README, or of the badge, with what came out of each paper and what words mean.

    text: as it stands; comments mark the two blocks that are written into the README. papers: catalogues of all papers,
    with the numbers of their texts.
    """
    papers = list(papers)
    rows = {paper.slug: committed_claims(root, paper.slug) for paper in papers}
    blocks = {
        "answers": "".join(f"{answer(paper, rows[paper.slug])}\n" for paper in papers),
        "words": "".join(f"- **{word[0].upper()}{word[1:]}**: {meaning}\n" for word, meaning in words().items()),
    }
    text = _COUNTS.sub(badge([row for of_paper in rows.values() for row in of_paper])["message"], text)
    return _BLOCK.sub(lambda block: f"{block[1]}{blocks[block[2]]}{block[3]}", text)


def write(root: Path, papers: Iterable[Paper]) -> list[Path]:
    """Write what came out of each paper into the README and its badge; arguments as for `filled`; returns the files."""
    papers, paths = list(papers), [root / README, root / BADGE]
    texts = [filled(path.read_text(encoding="utf-8"), root, papers) for path in paths]
    for path, text in zip(paths, texts, strict=True):
        write_text(path, text)
    return paths
