"""What the README and the badge say of the papers and of words: written from the verdicts, never typed."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.committed import CommittedClaim, with_committed
from marsedl.replication.claims.counts import capital, counted
from marsedl.replication.claims.names import NUMBERS, STATEMENTS
from marsedl.replication.claims.printed import load_published
from marsedl.replication.files import write_text
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import Paper

if TYPE_CHECKING:
    from marsedl.replication.universes.judging import Judge

WORDS = Path(__file__).with_name("words.yaml")
README, BADGE = Path("README.md"), Path("docs/images/badge.svg")
UNIVERSES = Path("docs/universes.md")
_BLOCK = re.compile(r"(?ms)^(<!-- (answers|words|universes): written by `marsedl readme` -->\n).*?^(<!-- end -->)$")
_COUNTS = re.compile(r"\d+ of \d+ printed numbers; \d+ of \d+ statements")


def words() -> dict[str, str]:
    """Return the few words that report and README define before they use them; backticks mark code."""
    return {word: " ".join(text.split()) for word, text in read_yaml(WORDS).items()}


def badge(rows: Iterable[Claim | CommittedClaim]) -> str:
    """Count the verdicts on all papers' claims in one line."""
    of = counted(rows)
    reproduced, hold = of.verdicts[NUMBERS]["reproduced"], of.verdicts[STATEMENTS]["holds"]
    return f"{reproduced} of {of.numbers} printed numbers; {hold} of {of.statements} statements"


def committed_claims(root: Path, slug: str) -> list[CommittedClaim]:
    """Return the claims of a paper with their committed verdicts, in the printed order."""
    published = load_published(root / "data" / "published" / f"{slug}.yaml")
    return with_committed(root, slug, [(one.id, one.kind, one.headline) for one in published])


def with_universes(text: str, judges: Mapping[str, "Judge"]) -> str:
    """Return the text of the page on universes with what the committed runs say; judges: of them, by paper."""
    from marsedl.replication.universes.joint import in_sentences  # slow to import, as the next

    lines = "".join(f"- **{slug}**: {in_sentences(judge)}\n" for slug, judge in judges.items())
    return _BLOCK.sub(lambda block: f"{block[1]}\n{lines}{block[3]}", text)


def filled(text: str, root: Path, papers: Iterable[Paper]) -> str:
    """Return the text of the README, or of the badge, with what came out of each paper and what words mean.

    text: as it is; comments mark the two blocks that are written into the README. papers: catalogues of all papers,
    with the numbers of their texts.
    """
    papers = [(paper, committed_claims(root, paper.slug)) for paper in papers]
    every = [row for _, rows in papers for row in rows]
    of = counted(every)
    blocks = {
        "answers": f"**{of.of_headline}**; {of.of_numbers}; {of.of_statements}.\n\n"
        + "".join(_answer(paper, rows) for paper, rows in papers),
        "words": "".join(f"- **{capital(word)}**: {meaning}\n" for word, meaning in words().items()),
    }
    text = _COUNTS.sub(badge(every), text)
    return _BLOCK.sub(lambda block: f"{block[1]}{blocks[block[2]]}{block[3]}", text)


def _answer(paper: Paper, rows: Sequence[CommittedClaim]) -> str:
    """What came out of one paper, as an item of a list in Markdown."""
    of = counted(rows)
    counts = f"**{of.of_headline.replace(' headline', '** headline')}; {of.of_numbers}."
    asked = [paper.question or f"{paper.title}.", *paper.in_short[:1]]
    return f"- **[{paper.slug}](docs/papers/{paper.slug}.md)** ({paper.authors}). {' '.join([*asked, counts])}\n"


def write(root: Path, papers: Sequence[Paper], models: Mapping[str, type[Inputs]]) -> list[Path]:
    """Write what came out of each paper into the README, its badge and the page on universes; returns the files.

    models: the typed inputs of each paper.
    """
    from marsedl.replication.universes.judging import COMMITTED, committed_judge

    texts = {path: filled(path.read_text(encoding="utf-8"), root, papers) for path in (root / README, root / BADGE)}
    runs = [one.slug for one in papers if (root / COMMITTED / f"{one.slug}.h5").exists()]
    judges = {slug: committed_judge(slug, models[slug], root) for slug in runs}
    texts[root / UNIVERSES] = with_universes((root / UNIVERSES).read_text(encoding="utf-8"), judges)
    for path, text in texts.items():
        write_text(path, text)
    return list(texts)
