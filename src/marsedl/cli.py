"""The command `marsedl`: what there is, what it is made of, what differs, one trial again, the proof, a new paper."""

import argparse
import contextlib
import re
import sys
from pathlib import Path

from marsedl.replication.errors import InputError, MarsedlError

TARGETS = ("all", "claims", "comparison", "report", "verify")  # of the workflow, beside one for every paper


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns 0, 1 if things differ or fail, 2 for a request that cannot be met."""
    parser = argparse.ArgumentParser(
        prog="marsedl", description="Replications of papers on Mars entry, descent and landing under uncertainty."
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")

    commands.add_parser("list", help="papers, readings, figures, tables and the targets that build them")
    explain = commands.add_parser("explain", help="what a figure, table, stage or claim is made of")
    explain.add_argument("paper")
    explain.add_argument("item")
    explain.add_argument("--reading", default="corrected")
    diff = commands.add_parser("diff", help="compare two artifacts, figures, tables or folders of them")
    diff.add_argument("a", type=Path)
    diff.add_argument("b", type=Path)
    trial = commands.add_parser("trial", help="fly one trial of a Monte Carlo case again")
    trial.add_argument("paper")
    trial.add_argument("reading")
    trial.add_argument("case", nargs="?", default=argparse.SUPPRESS, help="the paper's first case unless given")
    trial.add_argument("number", type=int)
    trial.add_argument("--case", help="the same as an option")
    verify = commands.add_parser("verify", help="build the smoke size twice and compare; compare the full size")
    verify.add_argument("--no-rebuild", action="store_true", help="only compare the full size with the stored numbers")
    machines = commands.add_parser("machines", help="compare the smoke size under other instruction sets and libraries")
    machines.add_argument("names", nargs="*", metavar="machine", help="of instruction sets; all of them unless given")
    machines.add_argument(
        "--libraries", action="append", default=[], metavar="NAME=PYTHON", help="a Python with other versions"
    )
    machines.add_argument(
        "--paper", action="append", default=[], help="of this paper alone; may be given several times"
    )
    machines.add_argument("--cores", type=int, default=2)
    commands.add_parser("accept", help="show what the full size changes in the stored numbers, and store it")
    commands.add_parser("audit", help="count claims, figures, inputs, errata, targets; find what is left hanging")
    crate = commands.add_parser(
        "crate", help="describe the build for others: workflow, inputs, products, digests (RO-Crate)"
    )
    crate.add_argument("--config", nargs="*", default=[], help="as for snakemake, if it is not the full size")
    new = commands.add_parser("new-paper", help="write a small complete paper to begin another replication with")
    new.add_argument("slug", help="its name in files and targets, such as powered_descent")
    new.add_argument("--title", default="Title to be given")
    new.add_argument("--authors", default="Authors to be named")
    for command in (explain, trial):
        command.add_argument("--configfile", type=Path, help="a configuration of your own, as for snakemake")

    options = parser.parse_args(arguments)
    try:
        return _COMMANDS[options.command](options)
    except MarsedlError as error:
        print(f"marsedl: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()
        return 0


def project_root() -> Path:
    """Return the project's folder: the working directory or the nearest one above it that holds the Snakefile.

    Raises InputError if there is none.
    """
    here = Path.cwd()
    for folder in (here, *here.parents):
        if (folder / "Snakefile").exists() and (folder / "configs").is_dir():
            return folder
    raise InputError(f"{here} is not inside a marsedl project; change to the folder that holds its Snakefile")


def _studies(config_file=None) -> dict:
    """Return the studies of all papers, with a user's own readings."""
    from marsedl.papers import SLUGS, input_model
    from marsedl.replication.inputs import load_studies, read_yaml

    files = [] if config_file is None else [config_file.resolve()]
    config = {} if config_file is None else read_yaml(config_file) or {}
    models = {slug: input_model(slug) for slug in SLUGS}
    with contextlib.chdir(project_root()):  # from where files named by inputs are read
        return load_studies(models, Path("configs"), config, files)


def _study(paper, config_file=None):
    """Return the catalogue and the study of a paper, with a user's own readings."""
    from marsedl.papers import SLUGS, catalogue
    from marsedl.replication.inputs import nearest

    if paper not in SLUGS:
        raise InputError(f"there is no paper '{paper}'; {nearest(paper, SLUGS)}")
    return catalogue(paper), _studies(config_file)[paper]


def _reading(study, name):
    from marsedl.replication.inputs import nearest

    if name not in study.readings:
        raise InputError(f"{study.paper} has no reading '{name}'; {nearest(name, study.readings)}")
    return study.readings[name]


def _list(options) -> int:
    from marsedl.papers import SLUGS, catalogue

    for slug, study in _studies().items():
        paper = catalogue(slug)
        print(f"{slug}\n  {paper.title}\n  {paper.authors}\n\n  readings")
        readings = study.readings.values()
        _print_columns(4, [(r.name, r.summary + (f" (based on {r.based_on})" if r.based_on else "")) for r in readings])
        print("\n  figures (snakemake figures/" + slug + "/NAME.png, or figures/" + slug + "/READING/NAME.png)")
        _print_columns(4, [(stem, _first_sentence(product.caption)) for stem, product in paper.figures.items()])
        print("\n  tables (NAME.csv, NAME.md in the same places)")
        summaries = {**paper.summaries, "claims": "Every printed claim with its verdict."}
        rows = [(stem, _first_sentence(product.caption)) for stem, product in paper.tables.items()]
        rows += [(stem, f"{_first_sentence(caption)} (all readings)") for stem, caption in summaries.items()]
        _print_columns(4, rows)
        print("\n  stages (snakemake data/cache/" + slug + "/READING/NAME.h5)")
        _print_columns(4, [(name, stage.meaning) for name, stage in paper.stages.items()])
        print()
    print("targets: " + ", ".join([*TARGETS, *SLUGS]))
    return 0


def _first_sentence(caption) -> str:
    """Without its full stop; that of "Fig. 9" ends no sentence."""
    return re.split(r"\. (?=[A-Z])", caption)[0].removesuffix(".")


def _print_columns(indent, rows) -> None:
    """Print rows of texts with their columns aligned."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))] if rows else []
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print(" " * indent + "  ".join(cells).rstrip())


def _explain(options) -> int:
    from marsedl.replication.claims import load_published
    from marsedl.replication.code_digest import reached
    from marsedl.replication.inputs import nearest

    paper, study = _study(options.paper, options.configfile)
    reading = _reading(study, options.reading)
    root = project_root()
    claims = {claim.id: claim for claim in load_published(root / "data" / "published" / f"{paper.slug}.yaml")}
    name = options.item
    if name in claims:
        claim = claims[name]
        print(f"claim {name}: {claim.quantity}\n  {claim.where}; printed {claim.printed} {claim.unit} ({claim.kind})")
        _print_verdict(root, paper.slug, name)
        return 0
    if name in paper.figures or name in paper.tables:
        item, kind = paper.product(name), "figures" if name in paper.figures else "tables"
        entry = f"marsedl.papers.{paper.slug}.{kind}:{name}"
        folder = f"figures/{paper.slug}" + ("" if reading.name == "corrected" else f"/{reading.name}")
        target = f"{folder}/{name}.{'png' if kind == 'figures' else 'csv'}"
        print(f"{kind[:-1]} {name} of {paper.slug}, reading {reading.name}\n  {item.caption}\n  snakemake {target}")
    elif name in paper.stages:
        item, entry = paper.stages[name], paper.entry(name)
        print(f"stage {name} of {paper.slug}, reading {reading.name}: {item.meaning}")
    else:
        known = [*paper.figures, *paper.tables, *paper.stages, *claims]
        raise InputError(f"{paper.slug} has no figure, table, stage or claim '{name}'; {nearest(name, known)}")
    namesakes = [kind for kind in ("figures", "tables", "stages") if name in getattr(paper, kind)][1:]
    if namesakes:
        print(f"  (also the name of a {' and a '.join(kind[:-1] for kind in namesakes)})")
    stages, names = _behind(paper, item)
    print("\nartifacts, in the order in which they are made")
    _print_columns(2, [(stage, paper.stages[stage].meaning) for stage in stages])
    print("\ninputs that it depends on")
    fields = [field for field in reading.inputs.__class__.model_fields if field in names]
    sources = [(reading.sources[field], field) for field in fields]
    _print_columns(2, [(s.key, str(s.written), study_unit(reading, s, field), s.source) for s, field in sources])
    print("\ncode that draws or computes it")
    for symbol in reached(entry, root / "src"):
        if "(at import)" not in symbol:
            print(f"  {symbol}")
    return 0


def study_unit(reading, source, field) -> str:
    """Return the unit in which an input is written."""
    suffix = source.key.removeprefix(field).removeprefix("_")
    return suffix.replace("_", "/") or reading.inputs.unit(field)


def _behind(paper, item) -> tuple[list[str], set[str]]:
    """All stages behind an item, first things first, and all inputs that they and the item use."""
    stages, names = [], set(item.inputs)

    def visit(needed):
        for need in needed:
            stage = need.split(".")[0]
            if stage not in stages:
                visit(paper.stages[stage].needs)
                stages.append(stage)
                names.update(paper.stages[stage].inputs)

    visit(item.needs)
    return stages, names


def _print_verdict(root, slug, claim) -> None:
    from marsedl.replication.claims import format_result, read_claims

    path = root / "report" / "claims.json"
    if not path.exists():
        print("  no verdict yet: run 'snakemake claims'")
        return
    row = next(row for row in read_claims(path) if (row["paper"], row["id"]) == (slug, claim))
    print(f"  verdict: {row['verdict']} (reading {row['reading']})\n  {row['reason']}".rstrip())
    _print_columns(
        4,
        [
            (name, result["verdict"] or "–", ", ".join(format_result(row, name)), result["evidence"] or "")
            for name, result in row["readings"].items()
        ],
    )


def _diff(options) -> int:
    from marsedl.replication.digests import difference, format_difference

    rows = difference(options.a, options.b)
    print(format_difference(rows))
    return 1 if rows else 0


def _trial(options) -> int:
    from importlib import import_module

    from marsedl.replication import jobs

    root = project_root()
    jobs.pin_numerics(root)
    paper, study = _study(options.paper, options.configfile)
    reading = _reading(study, options.reading)
    module = import_module(f"marsedl.papers.{paper.slug}.montecarlo")
    case = options.case or next(iter(reading.inputs.CASES))
    print(jobs.replay(root, paper, reading, case, options.number, module))
    return 0


def _verify(options) -> int:
    from marsedl.papers import SLUGS, rounding_noise
    from marsedl.replication import verification

    root = project_root()
    agree = True if options.no_rebuild else verification.build_twice(root)
    return 0 if verification.compare_reference(root, SLUGS, rounding_noise()) and agree else 1


def _machines(options) -> int:
    from marsedl.papers import SLUGS, rounding_noise
    from marsedl.replication import machines
    from marsedl.replication.inputs import nearest

    if unknown := next((paper for paper in options.paper if paper not in SLUGS), None):
        raise InputError(f"there is no paper '{unknown}'; {nearest(unknown, SLUGS)}")
    asked = machines.chosen(options.names, options.libraries)
    slugs = options.paper or SLUGS
    return 0 if machines.measure(project_root(), asked, slugs, rounding_noise(), options.cores) else 1


def _accept(options) -> int:
    from marsedl.papers import SLUGS, rounding_noise
    from marsedl.replication import audit, verification

    root = project_root()
    for path in verification.accept_reference(root, SLUGS, rounding_noise()):
        print(f"wrote {path}")
    print(f"wrote {verification.accept_inputs(root, _studies())}")
    results = _audited(root)
    print(audit.format_results(results, audit.read_counts(root)))
    print(f"wrote {audit.write_counts(root, results)}")
    return 1 if audit.findings(results) else 0


def _audit(options) -> int:
    from marsedl.replication import audit
    from marsedl.replication.verification import REMEDY

    root = project_root()
    results, committed = _audited(root), audit.read_counts(root)
    print(audit.format_results(results, committed))
    changed = audit.count_changes(results, committed)
    if changed:
        print(REMEDY)
    return 1 if changed or audit.findings(results) else 0


def _crate(options) -> int:
    from marsedl.papers import SLUGS, catalogue
    from marsedl.replication.crate import write_crate

    print(f"wrote {write_crate(project_root(), {slug: catalogue(slug) for slug in SLUGS}, *options.config)}")
    return 0


def _new_paper(options) -> int:
    from marsedl.replication.scaffold import new_paper, next_steps

    root = project_root()
    for path in new_paper(root, options.slug, options.title, options.authors):
        print(f"wrote {path.relative_to(root)}")
    print(f"\n{next_steps(options.slug)}")
    return 0


def _audited(root) -> list:
    """The audit of the project, all of its papers and comparisons."""
    from importlib import import_module

    from marsedl.comparison import COMPARISONS
    from marsedl.papers import catalogue
    from marsedl.replication import audit
    from marsedl.replication.claims import load_published

    subjects = [
        audit.Subject(
            catalogue(slug),
            study,
            load_published(root / "data" / "published" / f"{slug}.yaml"),
            import_module(f"marsedl.papers.{slug}.claims").DECLARATIONS,
        )
        for slug, study in _studies().items()
    ]
    return audit.audit(root, subjects, COMPARISONS, TARGETS)


_COMMANDS = {
    "list": _list,
    "explain": _explain,
    "diff": _diff,
    "trial": _trial,
    "verify": _verify,
    "machines": _machines,
    "accept": _accept,
    "audit": _audit,
    "crate": _crate,
    "new-paper": _new_paper,
}

if __name__ == "__main__":
    sys.exit(main())
