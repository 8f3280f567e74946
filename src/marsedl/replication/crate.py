"""A description of a build as an RO-Crate: what ran, from which inputs, and every product with its digest.

The description follows the Provenance Run Crate profile, and so Workflow Run Crate and RO-Crate 1.1: the workflow and
its run as a whole, and one action for every artifact, figure and table, with the files that it was made from.
"""

import hashlib
import os
import platform
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from marsedl.replication.assembly import CITATION, LIBRARIES
from marsedl.replication.catalogue import Paper
from marsedl.replication.claims import write_text
from marsedl.replication.errors import MarsedlError
from marsedl.replication.jobs import NUMERIC_ENVIRONMENT
from marsedl.replication.libraries import library_versions
from marsedl.replication.sharing import Shared
from marsedl.replication.sizes import build_folder, size_of
from marsedl.replication.verification import built_files

NAME = "ro-crate-metadata.json"
DEFAULT = "corrected"  # the reading of products without the name of one
VERSION = "0.1.0"
LICENCE = "https://spdx.org/licenses/MIT"
INPUTS = ("configs/*.yaml", "data/published/*.yaml", "data/atmosphere/*", "data/reference/*.csv")
SOURCES = ("workflow/", "src/", "profiles/")  # as folders
DOCUMENTS = ("requirements.lock", "pyproject.toml", "LICENSE", "CITATION.cff", "README.md", "container/Containerfile")
RESULTS = ("report/index.html", "report/claims.json", "report/badge.json", "report/digests.json")
PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": ("Process Run Crate", "0.5"),
    "https://w3id.org/ro/wfrun/workflow/0.5": ("Workflow Run Crate", "0.5"),
    "https://w3id.org/ro/wfrun/provenance/0.5": ("Provenance Run Crate", "0.5"),
    "https://w3id.org/workflowhub/workflow-ro-crate/1.0": ("Workflow RO-Crate", "1.0"),
}
_FORMATS = {
    ".css": "text/css",
    ".csv": "text/csv",
    ".h5": "application/x-hdf5",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".md": "text/markdown",
    ".pdf": "application/pdf",
    ".png": "image/png",
    ".yaml": "application/yaml",
    ".zip": "application/zip",
}


def write_crate(root: Path, papers: Mapping[str, Paper], shared: Mapping[str, Shared], *config: str) -> Path:
    """Describe a complete, up-to-date build as an RO-Crate in the project's folder.

    The description has the same bytes for the same files. Its date is `SOURCE_DATE_EPOCH`, and the fixed date of all
    products if that is not set: no clock is read.

    Args:
        root: the project's folder.
        papers: the catalogues by slug.
        shared: whose file each artifact is, by slug, of the size that is described.
        config: what was given with `--config` if it is not the plain full-size build.

    Returns:
        The file.

    Raises:
        MarsedlError: no build that is up to date, or the library is not installed.

    """
    try:
        from rocrate.rocrate import ROCrate
    except ModuleNotFoundError:
        raise MarsedlError(
            "the library 'rocrate' is not installed; install the extra 'crate' of this package"
        ) from None
    products = sorted(built_files(root, "all", *config))
    crate = ROCrate(version="1.1")
    crate.metadata.extra_terms["sha256"] = "https://w3id.org/ro/terms/workflow-run#sha256"
    _add_root(crate, root, papers.values())
    inputs = _files(crate, root, sorted({path for pattern in INPUTS for path in root.glob(pattern)}))
    build = build_folder(root, size_of(config))
    results = _files(crate, root, [build / name for name in products], build)
    workflow = _add_workflow(crate, root, inputs, results)
    actions = [
        crate.add_action(
            workflow,
            "#run",
            object=list(inputs.values()),
            result=list(results.values()),
            properties={
                "name": "snakemake all",
                "description": " ".join(["The whole workflow,", *(config or ["full size"])]),
                "actionStatus": "http://schema.org/CompletedActionStatus",
            },
        ),
        *_steps(crate, workflow, papers, shared, inputs, results),
    ]
    crate.root_dataset["mentions"] = actions
    (_, content), *_ = crate.metadata.stream()
    write_text(root / NAME, content.decode() + "\n")
    return root / NAME


def _add_root(crate: Any, root: Path, papers: Iterable[Paper]) -> None:
    """Add title, authors, licence, the replicated papers and the profiles that the crate follows."""
    date = datetime.fromtimestamp(
        int(os.environ.get("SOURCE_DATE_EPOCH") or NUMERIC_ENVIRONMENT["SOURCE_DATE_EPOCH"]), UTC
    )
    authors = _add(crate, "#authors", "Organization", {"name": "The marsedl developers"})
    licence = _add(crate, LICENCE, "CreativeWork", {"name": "MIT License", "identifier": "MIT"})
    profiles = [
        _add(crate, address, "CreativeWork", {"name": name, "version": version})
        for address, (name, version) in PROFILES.items()
    ]
    properties = {
        "name": "marsedl: replications of papers on Mars entry, descent and landing",
        "description": f"Figures, tables and printed numbers, regenerated, with a verdict on each claim. {CITATION}",
        "datePublished": date.isoformat(),
        "license": licence,
        "author": authors,
        "publisher": authors,
        "citation": [
            _add(crate, f"#{paper.slug}", "ScholarlyArticle", {"name": paper.title, "description": paper.citation})
            for paper in papers
        ],
        "conformsTo": profiles,
    }
    for name, value in properties.items():
        crate.root_dataset[name] = value
    documents = _files(crate, root, [root / name for name in DOCUMENTS])
    if "README.md" in documents:
        documents["README.md"]["about"] = crate.root_dataset
    for name in SOURCES:
        crate.add_dataset(dest_path=name, properties={"name": f"Source code: {name}"})


def _add_workflow(crate: Any, root: Path, inputs: Mapping[str, Any], results: Mapping[str, Any]) -> Any:
    """The workflow with its language, the versions of what it runs on, and its parameters."""
    versions = {"python": platform.python_version(), **library_versions(*LIBRARIES)}
    workflow = crate.add_workflow(
        dest_path="Snakefile",
        main=True,
        lang="snakemake",
        lang_version=versions["snakemake"],
        properties=_file_properties(root, "Snakefile"),
    )
    workflow["name"] = "marsedl"
    workflow["version"] = VERSION
    workflow["license"] = crate.dereference(LICENCE)
    workflow["author"] = crate.dereference("#authors")
    workflow["softwareRequirements"] = [
        _add(crate, f"#{name}-{version}", "SoftwareApplication", {"name": name, "softwareVersion": version})
        for name, version in versions.items()
    ]
    for kind, files in (("input", inputs), ("output", {name: results[name] for name in RESULTS})):
        for name, file in files.items():
            slot = crate.add_formal_parameter(name, "File", identifier=f"#{kind}-{name}")
            slot["workExample"] = file
            file["exampleOfWork"] = slot
            workflow.append_to(kind, slot)
    return workflow


def _steps(
    crate: Any,
    workflow: Any,
    papers: Mapping[str, Paper],
    shared: Mapping[str, Shared],
    inputs: Mapping[str, Any],
    results: Mapping[str, Any],
) -> list:
    """One action for every artifact, figure and table of a paper; what made them becomes part of the workflow."""
    tools, actions = {}, []
    for name, file in results.items():
        origin = _origin(name, papers)
        if origin is None:
            continue
        slug, reading, tool, meaning, needs = origin
        if tool not in tools:
            tools[tool] = _add(
                crate,
                f"#{tool}",
                "SoftwareApplication",
                {"name": tool, "description": meaning, "softwareVersion": VERSION},
            )
        sources = [shared[slug].file(reading, need) for need in needs if shared[slug].has(reading, need)]
        used = [inputs[f"configs/{slug}.yaml"], *(results[source] for source in sources if source in results)]
        properties = {
            "name": f"{tool.split('/')[1]} of {slug}, reading {reading}",
            "description": meaning,
            "actionStatus": "http://schema.org/CompletedActionStatus",
        }
        actions.append(
            crate.add_action(tools[tool], f"#run-{name}", object=_flat(used), result=file, properties=properties)
        )
    workflow["hasPart"] = list(tools.values())
    return actions


def _origin(name: str, papers: Mapping[str, Paper]) -> tuple[str, str, str, str, tuple[str, ...]] | None:
    """How a product of one reading of a paper is made: paper, reading, tool, its meaning, artifacts that it needs."""
    place, _, file = name.rpartition("/")
    folder, *parts = place.removeprefix("data/").split("/")
    stem, slug = file.rpartition(".")[0], next(iter(parts), None)
    if slug not in papers:
        return None
    paper, reading = papers[slug], parts[1] if len(parts) > 1 else DEFAULT
    if folder == "cache":
        stage = paper.stages[stem.split(".")[0]]
        return slug, reading, f"{slug}/{stem.split('.')[0]}", stage.meaning, stage.needs
    if folder == "figures" and stem in {**paper.figures, **paper.tables}:
        product = paper.product(stem)
        return slug, reading, f"{slug}/{stem}", product.caption, product.needs + product.optional
    return None  # what is made of all readings or all papers


def _files(crate: Any, root: Path, paths: Iterable[Path], folder: Path | None = None) -> dict[str, Any]:
    """Add files; returns them by their path below `folder`, the crate's own if it is not given."""
    entries = {}
    for path in filter(Path.is_file, paths):
        name = path.relative_to(root).as_posix()
        entry = crate.add_file(dest_path=name, properties=_file_properties(root, name))
        entries[path.relative_to(folder or root).as_posix()] = entry
    return entries


def _file_properties(root: Path, name: str) -> dict[str, str]:
    """The properties of a file: its name, format, size in bytes and SHA-256."""
    with (root / name).open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    size = (root / name).stat().st_size
    return {
        "name": name,
        "encodingFormat": _FORMATS.get(Path(name).suffix, "text/plain"),
        "contentSize": str(size),
        "sha256": digest,
    }


def _flat(items: list) -> Any:
    """The item of a list of one, else the list, as JSON-LD has it."""
    return items[0] if len(items) == 1 else items


def _add(crate: Any, name: str, kind: str, properties: Mapping[str, str]) -> Any:
    return crate.add_jsonld({"@id": name, "@type": kind, **properties})
