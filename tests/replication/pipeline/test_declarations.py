"""What functions declare by their signatures, read from the source of a toy paper."""

from textwrap import dedent
from typing import ClassVar

import pytest

from marsedl.replication.errors import InputError
from marsedl.replication.inputs.sections import Count, Inputs, Number, Section, given
from marsedl.replication.pipeline.catalogue import Paper, Product
from marsedl.replication.pipeline.declarations import declared
from marsedl.replication.pipeline.fingerprints import Fingerprints


class Planet(Section):
    """What pulls."""

    gravity: Number = given("m/s^2", "gravity")
    radius: Number = given("m", "radius")


class Ensemble(Section):
    """How many trials."""

    seed: Count = given("1", "seed")
    trials: Count = given("1", "trials")


class ToyInputs(Inputs):
    """All inputs."""

    CASES: ClassVar[dict[str, str]] = {"calm": "ensemble.trials"}

    planet: Planet
    ensemble: Ensemble


PACKAGE = {
    "nominal": '''
        from marsedl.papers.toy.helpers import fall
        from marsedl.replication.pipeline.catalogue import stage

        @stage()
        def compute(planet: Planet):
            """Fall down."""
            return fall(planet, 3.0)
    ''',
    "helpers": """
        def fall(planet: Planet, time):
            return planet.gravity * time

        def unused(planet: Planet):
            return planet.radius
    """,
    "studies": '''
        from marsedl.replication.pipeline.catalogue import stage

        @stage(claimed_in=("corrected",))
        def curvature(planet: Planet, nominal):
            """Curve."""
            return planet.radius
    ''',
    "montecarlo": '''
        from marsedl.replication.pipeline.catalogue import stage

        @stage()
        def simulate(ensemble: Ensemble, nominal, *, flown):
            """Fly one chunk."""
            return ensemble.seed

        @stage()
        def gather(planet: Planet, chunks):
            """Join chunks."""
            return planet.gravity
    ''',
    "figures": """
        def fig01(nominal, calm=None):
            return nominal
    """,
    "tables": """
        def tab1(planet: Planet, published, nominal):
            return planet.radius
    """,
}


@pytest.fixture
def read(tmp_path):
    """Return the catalogue of the toy paper with some of its modules replaced or added."""

    def of(**modules):
        folder = tmp_path / "src" / "marsedl" / "papers" / "toy"
        folder.mkdir(parents=True, exist_ok=True)
        for package in (folder, folder.parent, folder.parent.parent):
            (package / "__init__.py").write_text("", encoding="utf-8")
        for name, source in {**PACKAGE, **modules}.items():
            (folder / f"{name}.py").write_text(dedent(source), encoding="utf-8")
        paper = Paper("toy", "", "", "", {"fig01": Product("A figure.")}, {"tab1": Product("A table.")})
        digests = Fingerprints(tmp_path / "memory.json", tmp_path / "src", tmp_path / "scripts")
        return declared(paper, ToyInputs, digests)

    return of


def test_inputs_are_what_a_stage_and_its_helpers_read(read):
    stages = read().stages
    assert stages["nominal"].inputs == ("planet.gravity",)
    assert stages["nominal"].needs == ()
    assert stages["nominal"].meaning == "Fall down"
    assert stages["nominal"].entries == ("marsedl.papers.toy.nominal:compute",)


TUPLES = {"setup": "Setup", "study": "Study", "other": "Other"}  # parameters with their types
SETUP = """
    from typing import NamedTuple

    class Setup(NamedTuple):
        planet: Planet
        ensemble: "Ensemble"

    class Study(NamedTuple):
        setup: Setup

    class Other(NamedTuple):
        planet: int
"""


@pytest.mark.parametrize(
    ("body", "inputs"),
    [
        ("setup.planet.gravity", ("planet.gravity",)),
        ("setup.planet.gravity, setup.ensemble.seed", ("ensemble.seed", "planet.gravity")),
        ("helpers.fall(setup.planet, 3.0)", ("planet.gravity",)),
        ("helpers.fall(setup.planet, setup.ensemble.seed)", ("ensemble.seed", "planet.gravity")),
        ("setup.planet", ()),
        ("planet = setup.planet; planet.gravity", ("planet.gravity",)),
        ("a, b = setup.ensemble, setup.planet; b.radius, a.seed", ("ensemble.seed", "planet.radius")),
        ("[lambda: setup.planet.radius]", ("planet.radius",)),
        ("study.setup.planet.radius", ("planet.radius",)),
        ("setup = study.setup; mars = setup.planet; mars.radius", ("planet.radius",)),
        ("other.planet.gravity", ()),
        ("setup.planet.radius.real", ("planet.radius",)),
    ],
)
def test_inputs_are_followed_through_named_tuples_of_sections(read, body, inputs):
    *assigned, last = body.split("; ")
    parameters = ", ".join(f"{name}: {kind}" for name, kind in TUPLES.items() if f"{name} =" not in body)
    helper = "".join(f"    {line}\n" for line in (*assigned, f"return {last}"))
    stage = "from marsedl.papers.toy import helpers\nfrom marsedl.papers.toy.setups import Other, Setup, Study\n"
    stage += "from marsedl.replication.pipeline.catalogue import stage\n"
    stage += f"def helper({parameters}):\n{helper}"
    stage += '@stage()\ndef compute(planet: Planet, ensemble: Ensemble):\n    """Study."""\n'
    stage += "    return helper(Setup(planet, ensemble))\n"
    assert read(setups=SETUP, study=stage).stages["study"].inputs == inputs


def test_what_flies_a_case_and_joins_its_chunks_is_one_stage(read):
    stages = read().stages
    assert next(iter(stages)) == "nominal"
    assert stages["montecarlo"].inputs == ("ensemble.seed", "planet.gravity")
    assert stages["montecarlo"].entries == tuple(f"marsedl.papers.toy.montecarlo:{f}" for f in ("simulate", "gather"))


def test_products_declare_artifacts_optional_ones_and_printed_values(read):
    paper = read()
    figure, table = paper.figures["fig01"], paper.tables["tab1"]
    assert (figure.needs, figure.optional, figure.published) == (("nominal",), ("montecarlo.calm",), False)
    assert (table.needs, table.inputs, table.published) == (("nominal",), ("planet.radius",), True)


@pytest.mark.parametrize("setting", ["claimed_in=READINGS", "**SETTINGS"])
def test_a_setting_of_a_stage_that_is_no_literal_is_refused(read, setting):
    body = PACKAGE["studies"].replace('claimed_in=("corrected",)', setting)
    assert setting in body
    with pytest.raises(InputError, match=r"toy.studies:curvature: write .* of 'stage' as a literal"):
        read(studies=body)


def test_an_unknown_parameter_names_the_nearest(read):
    with pytest.raises(InputError, match=r"figures:fig01: the parameter 'nominl' is not a section.*mean 'nominal'\?"):
        read(figures="def fig01(nominl):\n    return nominl\n")


def test_a_function_that_is_not_written_is_named(read):
    with pytest.raises(InputError, match="figures:fig01: there is no such function"):
        read(figures="")
