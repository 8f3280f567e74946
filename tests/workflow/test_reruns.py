"""What reruns after a change, and what does not, in a built tree."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.code_digest import reachable_symbols
from marsedl.replication.inputs import load_study
from marsedl.replication.sharing import Shared

pytestmark = pytest.mark.workflow

FACTS = {
    slug: yaml.safe_load((Path(__file__).parent / "facts" / f"{slug}.yaml").read_text(encoding="utf-8"))
    for slug in SLUGS
}
CONFIG = "configs/powered_descent.yaml"
COMPARED = {"printed", "printed_eq46", "corrected", "euler", "kilonewton_noise"}  # at smoke size
PACKAGE = "src/marsedl"
PHYSICS = f"{PACKAGE}/models/dynamics/powered_descent.py"
FIGURES = f"{PACKAGE}/papers/powered_descent/figures.py"
STATISTICS = f"{PACKAGE}/montecarlo/statistics.py"
SUMMARY = {"digests", "site"}
JUDGED = {"claims", "counterexamples"}  # for each paper
CLAIMS = {*JUDGED, "all_claims", *SUMMARY}
FLIGHTS = {"montecarlo", "montecarlo_chunk", "montecarlo_gather"}
FLOWN_TOGETHER = ("closed_loop", "open_loop", "prior_mass", "wide_switch")  # of few trials each
PRODUCTS = {"figure", "table"}
DRAWN_FROM_TRIALS = {"fig03", "fig04", "fig05", "fig06b", "fig07", "eq54", "eq54_tests"}


def test_a_second_run_has_nothing_to_do(tree):
    before = tree.state()
    process = tree.run("all")
    assert process.returncode == 0
    assert "Nothing to be done" in process.stdout
    assert tree.state() == before


def test_touched_files_are_not_changed_files(copied):
    """Products first and sources last, so that by their times everything is out of date."""
    files = sorted(path for path in copied.folder.rglob("*") if path.is_file() and ".snakemake" not in path.parts)
    for number, path in enumerate(sorted(files, key=lambda path: path.suffix in (".py", ".smk", ".yaml"))):
        os.utime(path, ns=(2 * 10**18 + number,) * 2)
    assert copied.plan("all").rules == set()


def test_a_copied_tree_has_nothing_to_do(tree, tmp_path):
    copied = type(tree)(tmp_path / "another folder")
    shutil.copytree(tree.folder, copied.folder, copy_function=shutil.copyfile)  # without times
    assert copied.plan("all").rules == set()


def test_comments_docstrings_and_blank_lines_rerun_nothing(copied):
    copied.edit(PHYSICS, '    """Norm of the thrust, ||u|| (Eq. 2)', '\n\n    """Size of the thrust, ||u|| (Eq. 2)')
    copied.edit(PHYSICS, "    return np.sqrt(", "    # Never negative.\n    return np.sqrt(")
    for script in sorted(copied.path("workflow/scripts").glob("*.py")):
        script.write_text("# A comment.\n\n" + script.read_text(encoding="utf-8"), encoding="utf-8")
    copied.edit("workflow/scripts/stage.py", '"""Run one stage:', '"""Do one stage:')
    for slug in SLUGS:
        copied.edit(f"configs/{slug}.yaml", "\nreadings:\n", "\n# Another comment.\nreadings:\n")
    for module in sorted(copied.path(PACKAGE).rglob("*.py")):
        module.write_text(module.read_text(encoding="utf-8") + "\n\n# A comment at the end.\n", encoding="utf-8")
    assert copied.plan("all").rules == set()


def test_an_edited_script_reruns_its_jobs(copied):
    copied.edit(
        "workflow/scripts/tables.py", "with guarded(snakemake) as job:", "with guarded(snakemake) as job:\n    pass"
    )
    plan = copied.plan("all")
    assert plan.changed_rules == {"table"}
    assert plan.rules == {"table", *SUMMARY}


@pytest.mark.parametrize("slug", SLUGS)
def test_the_physics_of_a_paper_reruns_its_users_and_what_depends_on_them(copied, slug):
    edit = FACTS[slug]["physics"]
    copied.edit(f"{PACKAGE}/{edit['file']}", edit["old"], edit["new"])
    plan = copied.plan("all")
    assert plan.papers == {slug, *edit.get("shared_with", ())}
    mine, other_plans = plan.of(slug), [plan.of(paper) for paper in plan.papers - {slug}]
    assert mine.changed_rules == set(edit["changed"])
    paper = catalogue(slug)
    products = {name for name, stems in (("figure", paper.figures), ("table", paper.tables)) if stems}
    assert mine.rules == {*edit["rerun"], *products, *JUDGED}
    assert plan.rules == mine.rules.union(CLAIMS, {"comparison_product"}, *(other.rules for other in other_plans))
    shared = Shared(paper, load_study(slug, input_model(slug), copied.path(f"configs/{slug}.yaml"), size="smoke"))
    paths = {path for reading in shared.readings for path in shared.claimed(reading).values()}
    rerun = {path.split("/")[3] for path in paths if Path(path).name.split(".")[0] in edit["rerun"]}
    assert mine.readings == rerun, "readings that own what has changed"


@pytest.mark.parametrize(
    ("slug", "function", "users"),
    [(slug, function, users) for slug in SLUGS for function, users in FACTS[slug]["reach"].items()],
)
def test_the_code_of_a_stage_is_what_it_can_reach(slug, function, users):
    """Dry runs show only the first reason of each job, so the users of a function are also asked for by name."""
    paper, symbol = catalogue(slug), f"marsedl.{function}"
    assert {
        name
        for name, stage in paper.stages.items()
        if any(symbol in reachable_symbols(entry) for entry in stage.entries)
    } == set(users)


@pytest.mark.parametrize(
    ("part", "module", "old", "new"),
    [
        ("logarithm", "elementary.py", "s = f / (2.0 + f)", "s = f / (f + 2.0)"),  # for normals
        ("exponential", "elementary.py", "c = r - z * (", "c = r - 1.0 * z * ("),
        ("runge_kutta", "integrators.py", "sixth = step / 6.0", "sixth = 1.0 * step / 6.0"),
    ],
)
def test_the_engine_reruns_the_flights_of_the_papers_that_use_it(copied, part, module, old, new):
    users = {slug: FACTS[slug]["engine"][part] for slug in SLUGS if part in FACTS[slug]["engine"]}
    copied.edit(f"{PACKAGE}/montecarlo/{module}", old, new)
    plan = copied.plan("all")
    assert plan.papers == users.keys()
    for slug, stages in users.items():
        mine, cases = plan.of(slug), {f"montecarlo.{case}" for case in input_model(slug).CASES}
        assert mine.changed_rules >= set(stages)
        assert {name.split("/")[1] for name in mine.artifacts} >= cases
        assert mine.rules >= {"montecarlo", *PRODUCTS, *JUDGED}


def test_a_function_of_one_stage_reruns_that_stage_and_what_shows_it(copied):
    copied.edit(
        f"{PACKAGE}/methods/covariance_steering/fixed_point.py",
        '    "diverged: an iterate is not finite",',
        '    "diverged: some iterate is not finite",',
    )
    plan = copied.plan("all")
    assert plan.changed_rules == {"fixed_point"}
    assert plan.artifacts == {"printed/fixed_point", "corrected/fixed_point"}
    assert plan.rules == {"fixed_point", "figure", "table", *CLAIMS}
    assert plan.figures == {"fixed_point", "algorithm_1", "algorithm_1_loose"}


def test_a_figure_of_its_own_reruns_alone(copied):
    copied.edit(FIGURES, '"position gain"', '"gain of position"')
    plan = copied.plan("all")
    assert plan.rules == {"figure", *SUMMARY}
    assert plan.figures == {"fig06a"}


def test_a_statistic_reruns_the_figure_that_shows_it(copied):
    copied.edit(
        STATISTICS,
        "chdtri(degrees, 1.0 - tail) / degrees, variance *",
        "chdtri(degrees, 1 - tail) / degrees, variance *",
    )
    plan = copied.plan("all")
    assert plan.rules >= SUMMARY
    assert plan.artifacts == set()
    mine = plan.of("powered_descent")
    assert mine.rules == {"figure"}
    assert mine.figures == {"fig07"}


def test_a_statistic_of_claims_and_tables_reruns_them(copied):
    copied.edit(
        STATISTICS, "    return np.sqrt(variance_of_covariance)", "    return np.sqrt(1.0 * variance_of_covariance)"
    )
    plan = copied.plan("all")
    assert plan.rules >= CLAIMS
    assert plan.artifacts == set()
    mine = plan.of("powered_descent")
    assert mine.changed_rules == {"claims", "table"}
    assert mine.rules == {*JUDGED, "table"}


def test_an_upgraded_library_reruns_what_uses_it_and_says_so(copied):
    """As its installer leaves it, in the first folder that Python looks into: the solver of the cone programs."""
    metadata = copied.path("src/clarabel-99.0.dist-info/METADATA")
    metadata.parent.mkdir()
    metadata.write_text("Metadata-Version: 2.1\nName: clarabel\nVersion: 99.0\n", encoding="utf-8")
    plan = copied.plan("all").of("powered_descent")
    assert plan.changed_rules == plan.stages == {"certificates"}
    assert plan.rules == {"certificates", "table", *JUDGED}
    output = copied.run("data/cache/powered_descent/corrected/certificates.h5", "--dry-run", "--quiet", "host").stdout
    assert "clarabel 99.0" in output[output.index("Params have changed") :]


def test_an_artifact_that_was_copied_from_another_build_is_refused_until_it_is_deleted(tree, tmp_path):
    """Whole and under an old date, so that Snakemake sees no change."""
    folder, digests = "data/cache/powered_descent/kilonewton_noise", tree.digests()
    copied, target = f"{folder}/linearization.h5", f"{folder}/gains.h5"
    tree.set_inputs("kilonewton_noise", noise_coefficient="0.03")
    assert tree.run(target).returncode == 0
    shutil.copy(tree.path(copied), tmp_path)
    tree.edit(CONFIG, '      noise_coefficient: {value: 0.03, source: "assumed: test"}\n', "")
    assert tree.run(target).returncode == 0
    shutil.copy(tmp_path / "linearization.h5", tree.path(copied))
    os.utime(tree.path(copied), (10**9, 10**9))
    assert tree.plan(target).rules == set()
    tree.path(target).unlink()
    process = tree.run(target)
    assert process.returncode != 0
    output = (
        "comes from another build, of size 'smoke': noise.noise_coefficient is 0.03, not 0.02; another nominal.h5: "
        "delete it"
    )
    assert f"job powered_descent_gains: {copied}: {output} and run snakemake again" in process.stdout
    tree.path(copied).unlink()
    assert tree.run(target).returncode == 0
    assert tree.digests() == digests


def test_a_printed_value_reruns_the_claims_and_no_artifact(copied):
    published = copied.path("data/published/powered_descent.yaml")
    published.write_text(published.read_text(encoding="utf-8") + "\n# A comment.\n", encoding="utf-8")
    plan = copied.plan("all")
    assert plan.rules >= CLAIMS
    assert plan.artifacts == set()
    # What stands beside Eq. 54 and the printed masses shows printed values too.
    assert plan.figures <= {"fig05", "eq54", "eq54_tests", "choices_of_mass", "choices_of_simulation"}


def test_an_input_of_figures_reruns_no_artifact(copied):
    copied.set_inputs("corrected", ellipse_sigma="2.5")
    plan = copied.plan("all")
    assert plan.figures == {"fig02", "fig03"}
    assert plan.rules == {"figure", *CLAIMS}


def test_the_number_of_drawn_trials_reruns_the_flights(copied):
    copied.set_inputs("corrected", drawn_trials="15")
    plan = copied.plan("all")
    assert plan.rules == {*FLIGHTS, *PRODUCTS, "comparison_product", *CLAIMS}
    assert plan.readings == COMPARED - {"printed", "printed_eq46"}
    assert plan.stages == {"montecarlo"}
    assert plan.figures == DRAWN_FROM_TRIALS


def test_the_maximum_thrust_reruns_what_uses_it_and_no_design(copied):
    copied.edit(CONFIG, "coefficient_unit: {value: maximum_thrust,", "coefficient_unit: {value: other,")
    copied.set_inputs("corrected", maximum_thrust="17000.0")
    plan = copied.plan("all")
    assert plan.stages == {"montecarlo", "fixed_point"}
    assert plan.figures == {*DRAWN_FROM_TRIALS, "fixed_point", "algorithm_1", "algorithm_1_loose"}


def test_one_readings_input_leaves_the_other_readings_alone(tree):
    """Run for real, there and back again."""
    folder = "data/cache/powered_descent/kilonewton_noise"
    target = f"{folder}/montecarlo.closed_loop.h5"
    before, digests = tree.state(), tree.digests()
    tree.set_inputs("kilonewton_noise", noise_coefficient="0.03")
    plan = tree.plan("all")
    assert plan.readings == {"kilonewton_noise"}
    assert plan.figures == set()
    assert tree.run(target).returncode == 0
    after = tree.state()
    changed_files = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
    assert changed_files == {
        # One job flies all cases.
        f"{folder}/{name}.h5"
        for name in ("nominal", "linearization", "gains", *(f"montecarlo.{case}" for case in FLOWN_TOGETHER))
    }
    assert {f"{folder}/gains.h5", target} <= {name for name, new in tree.digests().items() if new != digests[name]}
    tree.edit(CONFIG, '      noise_coefficient: {value: 0.03, source: "assumed: test"}\n', "")
    assert tree.run(target).returncode == 0
    assert tree.digests() == digests


def test_an_input_of_a_hypothesis_reruns_its_gains_and_flights_alone(copied):
    copied.edit(
        "configs/stochastic_entry.yaml",
        "partition_interval: {value: 10.0, unit: s,",
        "partition_interval: {value: 6.0, unit: s,",
    )
    plan = copied.plan("all")
    assert plan.papers == {"stochastic_entry"}
    assert plan.readings == {"partition_24"}, "partition_20 is based on it, but has an interval of its own"
    assert plan.changed_rules == {"gains"}
    assert plan.rules == {"gains", "montecarlo", *CLAIMS}


def test_a_limit_of_the_stochastic_law_reruns_no_nominal_and_no_linear_model(copied):
    copied.set_inputs("corrected", paper="stochastic_entry", altitude_limit="2500.0")
    plan = copied.plan("all")
    assert plan.papers == {"stochastic_entry"}
    assert plan.stages == {"gains", "certificates", "tradeoff", "error_budget", "combinations", "montecarlo"}
    assert "printed" not in plan.readings
    assert plan.figures.isdisjoint({"fig01", "fig02", "fig03", "fig04", "fig05", "fig06", "fig07", "tab02", "zf"})


def test_the_double_integrator_and_the_aerocapture_do_not_rerun_each_other(copied):
    copied.set_inputs("corrected", paper="random_field", double_integrator_period="0.4")
    plan = copied.plan("all")
    assert plan.papers == {"random_field"}
    assert plan.stages == {"double_integrator", "double_integrator_flights"}
    assert plan.readings == {"corrected", "cc_to_4", "printed"}, "printed had that of corrected; others claim none"
    assert plan.figures >= {"fig04", "fig05"}
    assert plan.figures.isdisjoint({"fig09", "fig10", "fig12", "fig15"})


def test_a_percentile_of_one_reading_reruns_its_design_and_flights(copied):
    copied.edit(
        "configs/random_field.yaml",
        """  pf_printed:
    summary: As corrected, with p_f = 0.1, which is the 90th percentile.
    based_on: corrected
    guidance:
      percentile_tail: {value: 0.1,""",
        """  pf_printed:
    summary: As corrected, with p_f = 0.1, which is the 90th percentile.
    based_on: corrected
    guidance:
      percentile_tail: {value: 0.05,""",
    )
    plan = copied.plan("all")
    assert plan.readings == {"pf_printed"}
    assert plan.stages == {"gains", "montecarlo"}
    assert plan.changed_rules == {"gains"}


def test_a_density_table_is_an_input_by_its_numbers(copied):
    """The file is read when the configuration is: an edited number reruns its readings, other text of it nothing."""
    table = copied.path("data/atmosphere/mars_density.csv")
    text = table.read_text(encoding="utf-8")
    table.write_text("# A comment.\n" + text, encoding="utf-8")
    assert copied.plan("all").rules == set()
    rows = text.splitlines()
    number = next(n for n, row in enumerate(rows) if row.startswith("marsgram_2021a_sample_daily_mean,"))
    rows[number] = rows[number].replace("e-", "1e-", 1)  # one more digit
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")
    plan = copied.plan("all")
    assert plan.papers == {"random_field"}
    assert plan.readings == {"marsgram_daily_mean"}
    assert plan.stages >= {"nominal", "linearization", "gains", "montecarlo"}


def test_another_number_of_chunks_reruns_only_the_flights(copied):
    copied.config = ["size=smoke", "chunks=1"]
    plan = copied.plan("all")
    assert plan.stages == {"montecarlo"}
    # Cases of few trials that are not scattered are flown by one job.
    cases = {name.split(".")[1] for name in plan.of("powered_descent").artifacts}
    kinds = {"closed_loop", "open_loop", "prior_mass", "wide_switch"}
    assert cases == {*kinds, *(f"{kind}_large" for kind in kinds)}
    assert plan.rules.isdisjoint({"nominal", "linearization", "gains", "fixed_point", "certificates"})
