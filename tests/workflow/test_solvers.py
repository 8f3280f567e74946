"""Programs that come to no solution, by configuration alone: a message each, and the rest of the run is finished."""

import re

import pytest

from marsedl.papers import SLUGS, catalogue

pytestmark = pytest.mark.workflow

# Of each paper: what its reading sets, the artifact that cannot be made, and what is said: the case, the status, how
# far the solver came.
FAILING = {
    "powered_descent": (
        {"certificate_intervals": "[2, 3]"},
        "certificates",
        [
            *("segment 1: covariance program with 2 intervals: ", "status 'infeasible' (PrimalInfeasible) after "),
            *("residuals", "raise certificate_intervals"),
        ],
    ),
    "random_field": (
        {"double_integrator_final_three_sigma": "[1.0e-5, 1.0e-5]"},
        "double_integrator",
        ["double integrator: ", "status 'infeasible' (PrimalInfeasible) after ", "residuals"],
    ),
    "desensitized": (
        {"solver_iterations": "3"},
        "nominal",
        ["nominal: ", "Maximum_Iterations_Exceeded after 3 iterations", "the worst constraint is ", "off by "],
    ),
    "funnels": (
        {"nominal_iterations": "3"},
        "nominal",
        ["nominal: ", "Maximum_Iterations_Exceeded after 3 iterations", "the worst constraint is ", "off by "],
    ),
    "stochastic_entry": (
        {"altitude_limit": "1.0"},
        "gains",
        ["the stochastic law of the time trigger: ", "cannot be met", "standard deviation", "altitude_limit"],
    ),
}


def test_solvers_that_fail_say_so_and_leave_the_other_papers_of_the_run_finished(tree, own_reading, tmp_path):
    digests = tree.digests()
    path = tmp_path / "mine.yaml"
    readings, targets = [], []
    for slug, (inputs, artifact, _) in FAILING.items():
        readings.append(own_reading(slug, "unsolved", **inputs))
        targets.append(f"data/cache/{slug}/unsolved/{artifact}.h5")
    path.write_text("".join(readings), encoding="utf-8")
    lost = [f"data/cache/{slug}/corrected/{next(iter(catalogue(slug).stages))}.h5" for slug in SLUGS]
    for name in lost:
        tree.path(name).unlink()

    said = tree.fails(*targets, *lost, configfile=path)
    for slug, (_, artifact, fragments) in FAILING.items():
        start = f"folder build/smoke, paper {slug}, reading unsolved, job {artifact}: "
        messages = re.findall(rf"(?m)^{start}(.*)$", said)
        assert messages, f"{slug}: {said[-5000:]}"
        for fragment in fragments:
            assert fragment in messages[0]
        assert f"(log: build/smoke/logs/{slug}/unsolved/{artifact}.log)" in said
        assert not tree.path(f"data/cache/{slug}/unsolved/{artifact}.h5").exists()
    assert re.search(r"\(log: build/smoke/logs/\w+/unsolved/\w+\.log\)\s*$", said), "Snakemake's words come last"
    digests_after = tree.digests()
    assert {name: digests_after.get(name) for name in digests} == digests, "what can be made was made"
