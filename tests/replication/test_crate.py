"""The crate: what it says of a build, its bytes, and that the profile's own validator takes it, without network."""

import hashlib
import json
from pathlib import Path

import pytest
import rocrate
from rocrate.rocrate import ROCrate
from rocrate_validator import models, services
from rocrate_validator.utils.http import HttpRequester

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import crate
from marsedl.replication.errors import MarsedlError
from marsedl.replication.inputs import load_study
from marsedl.replication.sharing import Shared

CONTEXT = "https://w3id.org/ro/crate/1.1/context"
PROFILE = "provenance-run-crate"
PAPERS = {slug: catalogue(slug) for slug in SLUGS}
CONFIGS = Path(__file__).parents[2] / "configs"
SHARED = {
    "powered_descent": Shared(
        PAPERS["powered_descent"],
        load_study("powered_descent", input_model("powered_descent"), CONFIGS / "powered_descent.yaml"),
    )
}
PRODUCTS = (
    *crate.RESULTS,
    "report/claims/powered_descent.json",
    "data/cache/powered_descent/corrected/nominal.h5",
    "data/cache/powered_descent/corrected/linearization.h5",
    "data/cache/powered_descent/corrected/gains.h5",
    "data/cache/powered_descent/corrected/montecarlo.closed_loop.h5",
    "figures/powered_descent/fig07.png",
    "figures/powered_descent/printed/fig07.pdf",
    "figures/comparison/costs.csv",
)


class Response:
    """The context of RO-Crate 1.1, as far as the crate uses it: that of the library, which is of a later version."""

    status_code, ok, headers, url = 200, True, {"Content-Type": "application/ld+json"}, CONTEXT

    def __init__(self):
        content = json.loads((Path(rocrate.__file__).parent / "data" / "ro-crate.jsonld").read_text(encoding="utf-8"))
        workflow = "https://bioschemas.org/ComputationalWorkflow"
        content["@context"] |= {
            "ComputationalWorkflow": workflow,
            "FormalParameter": "https://bioschemas.org/FormalParameter",
        }
        content["@context"] |= {"input": f"{workflow}#input", "output": f"{workflow}#output"}
        del content["@context"]["sha256"]
        self.text = json.dumps(content)

    def json(self):
        return json.loads(self.text)

    def raise_for_status(self):
        pass


@pytest.fixture
def validate(monkeypatch):
    """The issues that the validator finds in a folder; any other address than that of the context is an error."""

    def get(self, address, **settings):
        assert address == CONTEXT
        return Response()

    monkeypatch.setattr(HttpRequester, "get", get, raising=False)
    monkeypatch.setattr(HttpRequester, "head", get, raising=False)

    def issues(folder):
        settings = services.ValidationSettings(
            rocrate_uri=models.URI(str(folder)),
            profile_identifier=PROFILE,
            requirement_severity=models.Severity.REQUIRED,
            no_cache=True,
        )
        return [issue.message for issue in services.validate(settings).get_issues()]

    return issues


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project in which everything is built: files with their own names in them."""
    sources = ("Snakefile", "README.md", "LICENSE", "requirements.lock", "configs/powered_descent.yaml")
    for name in (
        *sources,
        "workflow/x.smk",
        "src/x.py",
        "profiles/x",
        "data/published/powered_descent.yaml",
        *PRODUCTS,
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name, encoding="utf-8")
    monkeypatch.setattr(crate, "built_files", lambda root, target, *config: dict.fromkeys(PRODUCTS))
    return tmp_path


def graph(folder):
    content = json.loads((folder / crate.NAME).read_text(encoding="utf-8"))
    return {entity["@id"]: entity for entity in content["@graph"]}


def names(entity, key):
    values = entity[key]
    return {item["@id"] for item in (values if isinstance(values, list) else [values])}


def test_every_product_is_there_with_its_digest(project):
    entities = graph(crate.write_crate(project, PAPERS, SHARED).parent)
    for name in (*PRODUCTS, "Snakefile", "requirements.lock", "configs/powered_descent.yaml"):
        assert entities[name]["sha256"] == hashlib.sha256(name.encode()).hexdigest()
        assert entities[name]["contentSize"] == str(len(name))
    assert names(entities["#run"], "result") == set(PRODUCTS)
    assert names(entities["#run"], "instrument") == names(entities["./"], "mainEntity") == {"Snakefile"}
    assert names(entities["#run"], "object") == {"configs/powered_descent.yaml", "data/published/powered_descent.yaml"}


def test_products_of_one_reading_say_what_they_were_made_from(project):
    entities = graph(crate.write_crate(project, PAPERS, SHARED).parent)
    folder = "data/cache/powered_descent/corrected"
    action = entities[f"#run-{folder}/montecarlo.closed_loop.h5"]
    assert names(action, "object") == {
        "configs/powered_descent.yaml",
        *(f"{folder}/{need}.h5" for need in PAPERS["powered_descent"].stages["montecarlo"].needs),
    }
    assert names(action, "instrument") == {"#powered_descent/montecarlo"}
    assert "#run-figures/powered_descent/printed/fig07.pdf" in entities
    assert "#run-figures/comparison/costs.csv" not in entities
    tools = {
        name
        for entity in entities.values()
        if entity.get("@type") == "CreateAction"
        for name in names(entity, "instrument")
    }
    assert names(entities["Snakefile"], "hasPart") == tools - {"Snakefile"}


def test_licence_software_and_citation(project):
    entities = graph(crate.write_crate(project, PAPERS, SHARED, "chunks=2").parent)
    assert names(entities["./"], "license") == {"https://spdx.org/licenses/MIT"}
    software = {entities[name]["name"] for name in names(entities["Snakefile"], "softwareRequirements")}
    assert software >= {"python", "snakemake", "numpy", "numba", "casadi", "clarabel"}
    assert "chunks=2" in entities["#run"]["description"]
    citations = {entities[name]["name"] for name in names(entities["./"], "citation")}
    assert citations == {paper.title for paper in PAPERS.values()}


def test_the_bytes_are_the_same_and_no_clock_is_read(project, monkeypatch):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    first = crate.write_crate(project, PAPERS, SHARED).read_bytes()
    assert crate.write_crate(project, PAPERS, SHARED).read_bytes() == first
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    assert (
        graph(crate.write_crate(project, PAPERS, SHARED).parent)["./"]["datePublished"] == "2001-09-09T01:46:40+00:00"
    )


def test_a_valid_crate_of_the_profile(project, validate):
    crate.write_crate(project, PAPERS, SHARED)
    assert validate(project) == []
    assert ROCrate(project).mainEntity.id == "Snakefile"


def test_the_validator_sees_a_file_that_is_gone(project, validate):
    crate.write_crate(project, PAPERS, SHARED)
    (project / "figures/powered_descent/fig07.png").unlink()
    assert any("figures/powered_descent/fig07.png" in message for message in validate(project))


@pytest.mark.workflow
def test_the_smoke_build_is_a_valid_crate(tree, validate):
    process = tree.marsedl("crate", "--config", *tree.config)
    assert process.returncode == 0, process.stderr
    assert validate(tree.folder) == []
    entities = graph(tree.folder)
    assert {f"build/smoke/{name}" for name in tree.state()} == names(entities["#run"], "result")


def test_a_build_that_is_not_up_to_date_is_not_described(project, monkeypatch):
    def refuse(*arguments):
        raise MarsedlError("older")

    monkeypatch.setattr(crate, "built_files", refuse)
    with pytest.raises(MarsedlError, match="older"):
        crate.write_crate(project, PAPERS, SHARED)
    assert not (project / crate.NAME).exists()


def test_a_missing_library_ends_in_a_message(project, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rocrate.rocrate", None)
    with pytest.raises(MarsedlError, match="'rocrate' is not installed; install the extra 'crate'"):
        crate.write_crate(project, PAPERS, SHARED)
