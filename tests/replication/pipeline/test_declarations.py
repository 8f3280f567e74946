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


INPUTS = """
    from marsedl.replication.inputs import sections

    class Planet:
        gravity = given("m/s^2", "gravity")
        radius = given("m", "radius")

    class Ensemble:
        seed = given("1", "seed")

    def check(planet: Planet, ensemble: Ensemble):
        return planet.radius > ensemble.trials

    class Inputs(sections.Inputs):
        CHECKS = (check,)

        planet: Planet
        ensemble: "Ensemble"
"""


def asking_for_all(read, body, inputs=INPUTS):
    """Return the catalogue with a stage that asks for all inputs and hands them to a helper of this body."""
    *assigned, last = body.split("; ")
    helper = "".join(f"    {line}\n" for line in (*assigned, f"return {last}"))
    stage = "from marsedl.papers.toy import helpers\nfrom marsedl.papers.toy.inputs import Inputs, Planet\n"
    stage += "from marsedl.replication.pipeline.catalogue import stage\n"
    stage += f"def helper(given: Inputs):\n{helper}"
    stage += '@stage()\ndef compute(given: Inputs, nominal):\n    """Study."""\n    return helper(given)\n'
    return read(inputs=inputs, study=stage)


@pytest.mark.parametrize(
    ("body", "inputs"),
    [
        ("given.planet.gravity", ("planet.gravity",)),
        ("given.planet.gravity, given.ensemble.seed", ("ensemble.seed", "planet.gravity")),
        ("helpers.fall(given.planet, 3.0)", ("planet.gravity",)),
        ("helpers.fall(given.planet, given.ensemble.seed)", ("ensemble.seed", "planet.gravity")),
        ("given.planet", ()),
        ("planet = given.planet; planet.gravity", ("planet.gravity",)),
        ("a, b = given.ensemble, given.planet; b.radius, a.seed", ("ensemble.seed", "planet.radius")),
        ("[lambda: given.planet.radius]", ("planet.radius",)),
        ("given.planet.radius.real", ("planet.radius",)),
    ],
)
def test_of_all_inputs_a_stage_is_given_those_that_are_read(read, body, inputs):
    """Neither what the checks of the inputs read, nor what is read of no section, is given."""
    study = asking_for_all(read, body).stages["study"]
    assert (study.inputs, study.needs) == (inputs, ("nominal",))


@pytest.mark.parametrize(
    ("old", "new", "counts"),
    [
        ('given("m", "radius")', 'given("m", "the radius")', True),  # of the section that is read
        ("planet: Planet\n", "planet: Other\n", True),
        ('given("1", "seed")', 'given("1", "the seed")', False),  # of another section
        ('ensemble: "Ensemble"', 'ensemble: "Other"', False),
        ("planet.radius > ensemble.trials", "planet.radius < ensemble.trials", False),
        ("CHECKS = (check,)", "CHECKS = ()", False),
    ],
)
def test_of_all_inputs_a_stage_reaches_the_sections_that_it_names(tmp_path, read, old, new, counts):
    def code(inputs):
        asking_for_all(read, "given.planet.gravity", inputs)
        digests = Fingerprints(tmp_path / "memory.json", tmp_path / "src", tmp_path / "scripts")
        return digests.code("marsedl.papers.toy.study:compute")

    assert old in INPUTS
    assert (code(INPUTS) != code(INPUTS.replace(old, new))) == counts


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
