"""The audit: every claim, figure, input and erratum has what belongs to it, and nothing disappears unnoticed.

Every rule counts what it looked at, and the counts are committed in `data/reference/audit.json`. What belongs to a
paper is counted exactly; of files, which come and go with every change, no fewer may be looked at than before.
"""

import ast
import json
import re
import subprocess
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from marsedl.replication.catalogue import Paper
from marsedl.replication.claims import (
    DEFAULT_READING,
    REFUTED_VERDICTS,
    STATED_READING,
    Declaration,
    PublishedClaim,
    explains,
    write_text,
)
from marsedl.replication.code_digest import remembered_digests
from marsedl.replication.errors import InputError, MarsedlError, nearest, shown
from marsedl.replication.inputs import Study
from marsedl.replication.verification import built_verdicts, committed_verdicts, planned_files, snakemake

COUNTS = Path("data") / "reference" / "audit.json"
PROJECT = "project"  # the part of what belongs to no paper

_FIGURE_FILES = ("png", "pdf")
_TABLE_FILES = ("csv", "md")
# Folders of one machine. An interpreter named in the first line of a script does not count.
_MACHINE_PATH = re.compile(
    r"(?<![\w.:/~<-])(?:file://)?/(?:home|root|work|tmp|usr|opt|var|etc|mnt|srv|media|Users|private|scratch)/\w"
    r"|\b[A-Z]:\\{1,2}Users\b"
)
_INDEX_ADDRESS = re.compile(
    r"(?i)https?://[^\s\"'<>)]*(?:pypi|pythonhosted|devpi|artifactory|nexus|/simple\b)"
    r"|index[-_]url[\s=:]+[\"']?\w+://"
    r"|(?:find-links|trusted-host)[\s=]+[\"']?[\w-]+\.\w"
)
# Of numpy.random: what must be given a seed, and what needs none; all else draws from a hidden global state.
_GENERATORS = ("default_rng", "Philox", "PCG64", "PCG64DXSM", "MT19937", "SFC64", "SeedSequence")
_TYPES = ("Generator", "BitGenerator")
_SEEDS = ("seed", "key", "entropy")
_UNPREDICTABLE = ("time.", "datetime.", "uuid.", "secrets.", "os.urandom", "os.getpid", "id", "hash")


@dataclass(frozen=True)
class Subject:
    """A paper as the audit sees it: its catalogue, its readings, what it prints, and what is declared about it."""

    paper: Paper
    study: Study
    published: Sequence[PublishedClaim]
    declarations: Mapping[str, Declaration]


@dataclass(frozen=True)
class Result:
    """What a rule counted in one part of the project, a paper or `PROJECT`, and the problems it found there."""

    rule: str
    part: str
    count: int
    findings: tuple[str, ...] = ()
    at_least: bool = False  # the count may rise without being committed


@dataclass(frozen=True)
class Plan:
    """The workflow as Snakemake plans it: its rules, those with an output that is asked for, and these outputs."""

    rules: frozenset[str]
    used: frozenset[str]
    files: frozenset[str]


def audit(
    root: Path, subjects: Sequence[Subject], comparisons: Collection[str], targets: Iterable[str]
) -> list[Result]:
    """Apply every rule to the project.

    Args:
        root: the project's folder.
        subjects: all papers.
        comparisons: the names of the comparisons across papers.
        targets: the rules without output that a user calls by name, beside the papers' own.

    Returns:
        The results by rule, of all papers first.

    Raises:
        MarsedlError: the workflow cannot be planned, or the files cannot be listed.

    """
    slugs = [subject.paper.slug for subject in subjects]
    planned = plan(root, [name for subject in subjects for name in _of_another_reading(subject.paper)])
    has_function = _functions(root)
    of_papers: list[Callable[[Subject], Result]] = [
        lambda subject: evaluated_claims(subject, verdicts_of(root, subject.paper.slug)),
        lambda subject: reasons(subject, verdicts_of(root, subject.paper.slug)),
        lambda subject: figures(subject.paper, planned, has_function),
        lambda subject: tables(subject.paper, planned, has_function),
        lambda subject: stages(subject.paper, planned, has_function),
        inputs,
        errata,
    ]
    texts = text_files(root)
    return [
        *(rule(subject) for rule in of_papers for subject in subjects),
        comparison_products(comparisons, planned, has_function),
        workflow_rules(planned, [*targets, *slugs]),
        machine_paths(texts),
        index_addresses(texts),
        randomness(texts),
    ]


# ------------------------------------------------------------------------------------------------------ of every paper


def verdicts_of(root: Path, slug: str) -> dict[str, dict[str, str]]:
    """Return the verdicts on a paper's claims by reading: of the build if there is one, else the committed ones."""
    return built_verdicts(root, slug) or committed_verdicts(root, slug)


def evaluated_claims(subject: Subject, verdicts: Mapping[str, Mapping[str, str]]) -> Result:
    """Every printed claim has a verdict in some reading, and every verdict a printed claim."""
    slug, ids = subject.paper.slug, [claim.id for claim in subject.published]
    findings = [
        f"data/published/{slug}.yaml: claim {name} has no result; write its function in "
        f"src/marsedl/papers/{slug}/claims and run 'snakemake claims'"
        for name in ids
        if not verdicts.get(name)
    ]
    findings += [
        f"data/published/{slug}.yaml: claim {name} has a result but is not in this file; run 'snakemake claims' if "
        "it was removed on purpose"
        for name in verdicts
        if name not in ids
    ]
    return Result("printed claims, each with a result of an evaluator", slug, len(ids), tuple(findings))


def reasons(subject: Subject, verdicts: Mapping[str, Mapping[str, str]]) -> Result:
    """Every claim that differs or fails names an erratum or an input that the paper withholds."""
    slug = subject.paper.slug
    refuted = [name for name, entry in verdicts.items() if entry.get(DEFAULT_READING) in REFUTED_VERDICTS]
    findings = [
        f"{slug}: claim {name} differs or fails and is unexplained; name an erratum or a withheld input in "
        f"the claim's decorator in src/marsedl/papers/{slug}/claims"
        for name in refuted
        if not explains(subject.declarations.get(name, Declaration()))
    ]
    return Result("claims that differ or fail, each with a reason", slug, len(refuted), tuple(findings))


def figures(paper: Paper, planned: Plan, has_function: Callable[[str], bool]) -> Result:
    """Every figure of the catalogue has targets, of every reading, and a drawing function; `picture` is one of them."""
    findings = [*_products(paper, "figures", paper.figures, (True, False), planned, has_function)]
    if paper.picture and paper.picture not in paper.figures:
        findings.append(
            f"src/marsedl/papers/{paper.slug}/texts.yaml: picture: there is no figure {shown(paper.picture)}; "
            f"{nearest(paper.picture, paper.figures)}"
        )
    return Result("figures, each with targets and a drawing function", paper.slug, len(paper.figures), tuple(findings))


def tables(paper: Paper, planned: Plan, has_function: Callable[[str], bool]) -> Result:
    """Every table has targets, of every reading unless it is over all readings, and a function that lays it out."""
    findings = [
        *_products(paper, "tables", paper.tables, (True, False), planned, has_function),
        *_products(paper, "tables", paper.summaries, (True,), planned, has_function),
    ]
    number = len(paper.tables) + len(paper.summaries)
    return Result("tables, each with targets and a function", paper.slug, number, tuple(findings))


def _products(paper, kind, stems, defaults, planned, has_function) -> Iterator[str]:
    for stem in stems:
        where = f"src/marsedl/papers/{paper.slug}/{kind}.py"
        if not has_function(f"marsedl.papers.{paper.slug}.{kind}:{stem}"):
            yield f"{where}: no function {stem}, which the paper's catalogue names; write it, or remove it there"
        for default in defaults:
            for path in _files(paper.slug, kind, stem, default):
                if path not in planned.files:
                    yield _no_target(path)


def _no_target(path: str) -> str:
    return f"{path}: no target; add a rule to workflow/rules that makes it"


def _files(slug: str, kind: str, stem: str, default: bool) -> list[str]:
    folder = f"figures/{slug}" if default else f"figures/{slug}/{STATED_READING}"
    return [f"{folder}/{stem}.{kind}" for kind in (_FIGURE_FILES if kind == "figures" else _TABLE_FILES)]


def _of_another_reading(paper: Paper) -> list[str]:
    """The products of a reading that `snakemake all` does not draw: targets of every reading exist, or none."""
    names = [name for stem in paper.figures for name in _files(paper.slug, "figures", stem, False)]
    return names + [name for stem in paper.tables for name in _files(paper.slug, "tables", stem, False)]


def stages(paper: Paper, planned: Plan, has_function: Callable[[str], bool]) -> Result:
    """Every stage of the catalogue has a rule and a function."""
    findings = []
    for name, stage in paper.stages.items():
        rule = f"{paper.slug}_{name}"
        if rule not in planned.rules:
            findings.append(f"workflow/rules/stages.smk: no rule {rule} for the stage {name}; fix its loop over stages")
        for entry in stage.entries:
            if not has_function(entry):
                module, _, function = entry.partition(":")
                findings.append(f"{module}: no function {function}, which the stage {name} names; write it")
    return Result("stages, each with a rule and a function", paper.slug, len(paper.stages), tuple(findings))


def _functions(root: Path) -> Callable[[str], bool]:
    """Whether there is a function "package.module:function" in the project's source."""
    digests = remembered_digests(root)

    def exists(entry: str) -> bool:
        try:
            return bool(digests.code(entry))
        except InputError:
            return False

    return exists


def inputs(subject: Subject) -> Result:
    """Every input has a source in every reading; inputs are counted as often as readings set them."""
    study, count, findings = subject.study, 0, []
    for reading in study.readings.values():
        count += len(reading.differences())
        findings += [
            f"{reading.origin}: readings.{reading.name}.{name}: no source; say where the value comes from, or "
            "'assumed: why'"
            for name in reading.inputs.names()
            if name not in reading.sources or not reading.sources[name].source.strip()
        ]
    return Result("inputs as written, each with a source", study.paper, count, tuple(findings))


def errata(subject: Subject) -> Result:
    """Every erratum is named by a claim, a reading or the source of an input; readings that keep it exist."""
    slug, readings = subject.paper.slug, subject.study.readings.values()
    texts = [" ".join([*d.errata, d.reason, d.close.reason if d.close else ""]) for d in subject.declarations.values()]
    texts += [text for r in readings for text in (r.summary, *(source.source for source in r.sources.values()))]
    findings = [
        f"src/marsedl/papers/{slug}/__init__.py: erratum {erratum.id} ({erratum.printed}) is used nowhere; name it in "
        "the claim, the reading or the source of the input that it bears on"
        for erratum in subject.paper.errata
        if not any(re.search(rf"\b{re.escape(erratum.id)}\b", text) for text in texts)
    ]
    findings += [
        f"src/marsedl/papers/{slug}/texts.yaml: errata.{erratum.id}.kept_by: {problem}"
        for erratum in subject.paper.errata
        for name in erratum.kept_by
        if (problem := _not_kept_by(name, subject.study.readings))
    ]
    return Result(
        "errata, each named by a claim, a reading or an input", slug, len(subject.paper.errata), tuple(findings)
    )


def _not_kept_by(name: str, readings: Mapping[str, object]) -> str:
    """Why an erratum cannot be kept by a reading; nothing if it can."""
    if name not in readings:
        return f"there is no reading {shown(name)}; {nearest(name, readings)}"
    if name == DEFAULT_READING:
        return f"other readings are compared with {shown(name)}; name those that differ from it"
    return ""


# ------------------------------------------------------------------------------------------------------ of the project


def plan(root: Path, targets: Iterable[str]) -> Plan:
    """Let Snakemake plan `all` and further targets, in the configured chunks and in several of every case.

    Raises MarsedlError with Snakemake's output if it cannot.
    """
    plans = [planned_files(root, "all", *targets)]
    with ThreadPoolExecutor() as pool:  # after the first, which leaves digests of the code for them
        rule_listing = pool.submit(snakemake, root, "--list-rules")
        plans.append(planned_files(root, "claims", "--config", "chunks=2"))
        rule_list = rule_listing.result().stdout
    return Plan(
        rules=frozenset(line for line in rule_list.splitlines() if re.fullmatch(r"\w+", line)),
        used=frozenset(file["rule"] for files in plans for file in files.values()),
        files=frozenset(name for files in plans for name in files),
    )


def comparison_products(stems: Collection[str], planned: Plan, has_function: Callable[[str], bool]) -> Result:
    """Every comparison across papers has a figure and a table, each with targets and a function."""
    findings = []
    for stem in stems:
        for function, kinds in (("figure", _FIGURE_FILES), ("table", _TABLE_FILES)):
            if not has_function(f"marsedl.comparison.{stem}:{function}"):
                findings.append(f"src/marsedl/comparison/{stem}.py: no function {function}; write it")
            paths = [f"figures/comparison/{stem}.{kind}" for kind in kinds]
            findings += [_no_target(path) for path in paths if path not in planned.files]
    return Result("comparisons, each with targets and functions", PROJECT, len(stems), tuple(findings))


def workflow_rules(planned: Plan, targets: Iterable[str]) -> Result:
    """Every rule makes something that is asked for, or is a target that users call; and these exist."""
    targets = set(targets)
    findings = [
        f"workflow/rules: nothing asks for rule {name}; remove it, or add what it makes to a target"
        for name in sorted(planned.rules - planned.used - targets)
    ]
    findings += [f"Snakefile: there is no target {name}; add its rule" for name in sorted(targets - planned.rules)]
    return Result("workflow rules, each asked for", PROJECT, len(planned.rules), tuple(findings))


def text_files(root: Path) -> dict[str, str]:
    """Return the text files that are tracked, or would be, by path; raises MarsedlError if they cannot be listed."""
    # Lists files that are not ignored, in a checkout as well as in a plain folder.
    command = ["git", "grep", "--no-index", "--exclude-standard", "-lIz", "-e", ""]
    try:
        listing = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        reason = getattr(error, "stderr", None) or error
        raise MarsedlError(f"{root}: git cannot list the project's files ({reason}); install git") from None
    names = sorted(listing.stdout.split("\0")[:-1])
    return {name: (root / name).read_text(encoding="utf-8", errors="replace") for name in names}


def machine_paths(texts: Mapping[str, str]) -> Result:
    """No file names a folder of one machine."""
    findings = _matches(texts, _MACHINE_PATH, "an absolute path; name it relative to the project")
    return Result("text files, none with an absolute path", PROJECT, len(texts), tuple(findings), at_least=True)


def index_addresses(texts: Mapping[str, str]) -> Result:
    """No file holds the address of a package index."""
    findings = _matches(
        texts, _INDEX_ADDRESS, "the address of a package index; leave it to the machine's configuration"
    )
    return Result(
        "text files, none with the address of a package index", PROJECT, len(texts), tuple(findings), at_least=True
    )


def _matches(texts: Mapping[str, str], pattern: re.Pattern, problem: str) -> Iterator[str]:
    for name, text in texts.items():
        for number, line in enumerate(text.splitlines(), start=1):
            if pattern.search(line) and not line.startswith("#!"):
                yield f"{name}:{number}: {problem}"


def randomness(texts: Mapping[str, str]) -> Result:
    """Every generator of random numbers is given a seed, and none has a hidden state or a seed from the clock."""
    number, findings = 0, []
    for name, text in texts.items():
        if name.endswith(".py") and re.search("random|rvs", text):  # else it draws no random numbers
            generators, problems = _random_numbers(ast.parse(text, filename=name))
            number += generators
            findings += [f"{name}:{line}: {problem}" for line, problem in problems]
    return Result("generators of random numbers, each with a seed", PROJECT, number, tuple(findings), at_least=True)


def _random_numbers(tree: ast.Module) -> tuple[int, list[tuple[int, str]]]:
    """The number of seeded generators in a module, and the lines where random numbers have no seed."""
    nodes = list(ast.walk(tree))
    bound = _imported(nodes)

    def dotted(node: ast.expr) -> str:
        if isinstance(node, ast.Name):
            return bound.get(node.id, node.id if node.id in _UNPREDICTABLE else "")
        if isinstance(node, ast.Attribute) and (base := dotted(node.value)):
            return f"{base}.{node.attr}"
        return ""

    calls = {id(node.func): node for node in nodes if isinstance(node, ast.Call)}
    number, problems = 0, []
    for node in nodes:
        if not isinstance(node, ast.Name | ast.Attribute):
            continue
        name, call = dotted(node), calls.get(id(node))
        module, _, function = name.rpartition(".")
        if name == "random.Random" or (module == "numpy.random" and function in _GENERATORS):
            problem = _problem_of_seed(call, dotted)
            number += not problem
        elif module == "random" or (module == "numpy.random" and function not in _TYPES):
            problem = "draws from a hidden global state; use a generator with a seed"
        elif getattr(node, "attr", "") == "rvs" and call and not any(k.arg == "random_state" for k in call.keywords):
            name, problem = "rvs", "has no random_state; give it a generator with a seed"
        else:
            continue
        problems += [(node.lineno, f"{name} {problem}")] if problem else []
    return number, problems


def _imported(nodes: Iterable[ast.AST]) -> dict[str, str]:
    """The full names of what a module imports, by the names that it uses."""
    bound = {}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and not node.level:
            bound |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            for alias in node.names:
                top = alias.name.partition(".")[0]
                bound[alias.asname or top] = alias.name if alias.asname else top
    return bound


def _problem_of_seed(call: ast.Call | None, dotted: Callable[[ast.expr], str]) -> str:
    if call is None:
        return "is passed on without a seed; call it with one"
    seeds = [*call.args[:1], *(keyword.value for keyword in call.keywords if keyword.arg in (*_SEEDS, None))]
    if not seeds or any(isinstance(seed, ast.Constant) and seed.value is None for seed in seeds):
        return "has no seed; give it one"
    for seed in seeds:
        names = [dotted(node.func) for node in ast.walk(seed) if isinstance(node, ast.Call)]
        for name in names:
            if name.startswith(tuple(p for p in _UNPREDICTABLE if p.endswith("."))) or name in _UNPREDICTABLE:
                return f"is seeded by {name}, which changes in every run; give it a number"
    return ""


# -------------------------------------------------------------------------------------------------------------- counts


def read_counts(root: Path) -> dict[str, dict[str, int]]:
    """Return the committed counts by rule and part; none if there is no such file."""
    path = root / COUNTS
    if not path.exists():
        return {}
    try:
        counts = json.loads(path.read_text(encoding="utf-8"))
        return {rule: {part: int(count) for part, count in parts.items()} for rule, parts in counts.items()}
    except (ValueError, AttributeError, TypeError) as error:
        raise InputError(f"{path}: cannot be read as counts ({error}); restore it, or run 'marsedl accept'") from None


def write_counts(root: Path, results: Sequence[Result]) -> Path:
    """Commit the counts of an audit; returns the file."""
    write_text(root / COUNTS, json.dumps(_by_rule(results), indent=1) + "\n")
    return root / COUNTS


def _by_rule(results: Iterable[Result]) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for result in results:
        counts.setdefault(result.rule, {})[result.part] = result.count
    return counts


def findings(results: Iterable[Result]) -> list[str]:
    """Return all findings, a line each."""
    return [finding for result in results for finding in result.findings]


def count_changes(results: Sequence[Result], committed: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return the counts that differ from the committed ones, a line each."""
    if not committed:
        return [f"{COUNTS}: no counts are committed"]
    changes = []
    for result in results:
        committed_count = committed.get(result.rule, {}).get(result.part)
        if committed_count is None:
            changes.append(f"{result.rule}: {result.part}: {result.count}, and no count is committed")
        elif result.count < committed_count or (result.count > committed_count and not result.at_least):
            least = "at least " * result.at_least
            changes.append(f"{result.rule}: {result.part}: {result.count}, committed is {least}{committed_count}")
    counted_parts = {(result.rule, result.part) for result in results}
    changes += [
        f"{rule}: {part}: no longer counted, committed is {count}"
        for rule, parts in committed.items()
        for part, count in parts.items()
        if (rule, part) not in counted_parts
    ]
    return changes


def format_results(results: Sequence[Result], committed: Mapping[str, Mapping[str, int]]) -> str:
    """Format the audit: a line per rule with its counts, then every finding and every changed count."""
    lines = []
    for rule, parts in _by_rule(results).items():
        several = f" ({', '.join(f'{part} {count}' for part, count in parts.items())})" if len(parts) > 1 else ""
        lines.append(f"{sum(parts.values()):6d} {rule}{several}")
    all_findings, changes = findings(results), count_changes(results, committed)
    lines += [f"  {finding}" for finding in all_findings]
    lines += [f"  {change}" for change in changes]
    lines.append(f"{len(all_findings)} findings, {len(changes)} counts changed")
    return "\n".join(lines)
