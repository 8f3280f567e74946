"""The claims of a build, judged again from its artifacts: an artifact that was edited and sealed again is found."""

from collections.abc import Mapping
from pathlib import Path

from marsedl.replication.checks.reference import compare, fingerprints, format_changes
from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.counts import plural
from marsedl.replication.claims.printed import load_measured, published_by_id
from marsedl.replication.claims.rows import Evaluations, read_as, read_claims
from marsedl.replication.claims.writing import claims_of, judged
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.pipeline.products import BENCHMARKS
from marsedl.replication.records import store
from marsedl.replication.terminal import summarize


def judged_again(root: Path, build: Path, slug: str, given: Mapping) -> list[Claim]:
    """Return a paper's claims as the job of its claims judges them; given: what that job is given beside products.

    What named readings give, which have no artifacts, is taken from the build.
    """

    def asked(reading: str) -> Arguments:
        files = given["artifacts"][reading]

        def load(name: str, kind: type) -> object:
            return store.load(build / files[name], kind, paper=slug) if name in files else None

        return Arguments(given["inputs"][reading], load)

    published = published_by_id(root / "data" / "published" / f"{slug}.yaml")
    measured = load_measured(root / BENCHMARKS, slug) if given["measured"] else None
    points = read_as(Evaluations, build / f"report/points/{slug}.json")
    return judged(
        claims_of(slug), {name: asked(name) for name in given["inputs"]}, published, points, measured, **given["judged"]
    )


def check_judged(root: Path, build: Path, given: Mapping[str, Mapping]) -> bool:
    """Judge the claims of papers again, and return whether all are as the build has them; prints what differs.

    given: by paper, see `judged_again`
    """
    lines, agree = [], True
    for slug, of in given.items():
        rows, again = read_claims(build / f"report/claims/{slug}.json"), judged_again(root, build, slug, of)
        changes = format_changes(compare(fingerprints(rows, {}), fingerprints(again, {})), again)
        result = "others, so a file was changed by hand" if changes else "the same verdicts and numbers"
        lines.append(f"{slug}: {plural(len(again), 'claim')} judged again from artifacts: {result}")
        lines += [changes] if changes else []
        agree = agree and not changes
    print("\n".join(lines), flush=True)
    summarize("\n".join(lines))
    return agree
