import math
from dataclasses import replace

import numpy as np
import pytest

from marsedl.replication.claims.claim import Claim, Doubt, Tolerance
from marsedl.replication.claims.counts import counted
from marsedl.replication.claims.names import COUNTED_VERDICTS
from marsedl.replication.claims.numbers import format_number
from marsedl.replication.claims.printed import PublishedClaim, load_measured, load_published
from marsedl.replication.claims.rows import read_claims, write_claims
from marsedl.replication.claims.verdicts import Declaration, Evaluation, collect, judge
from marsedl.replication.errors import ArtifactError, InputError


def claim(**changes):
    named = {"paper": "paper", "id": "mass", "where": "Sec. V", "quantity": "final mass", "kind": "deterministic"}
    return PublishedClaim(**named, printed=1349, unit="kg", resolution=1).model_copy(update=changes)


CLOSE = Tolerance(reason="the step size is not stated", relative=0.01)


def verdict(claim, value, *rest, close=None, **options):
    return judge(claim, Evaluation(value, *rest, **options), Declaration(close=close)).verdict


# ---------------------------------------------------------------------------------------------------- loading


def load(tmp_path, text):
    path = tmp_path / "paper.yaml"
    path.write_text(text)
    return load_published(path)


ENTRY = """
claims:
  - id: mass
    where: Sec. V
    quantity: final mass
    printed: 1349
    unit: kg
    resolution: 1
    kind: monte_carlo
    trials: 2000
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("unit: kg", "unit: kg\n    units: kg", [":8: claims.mass.units: unknown key", "'unit'"]),
        ("kind: monte_carlo", "kind: montecarlo", [":9: claims.mass.kind", "'monte_carlo'"]),
        ("kind: monte_carlo", "kind: qualitative", [":6: claims.mass.printed", "boolean"]),
        ("    trials: 2000\n", "", [":3: claims.mass", "'trials' is missing"]),
        ("resolution: 1", "resolution: 0", ["claims.mass.resolution", "positive"]),
        ("printed: 1349", "printed: many", ["claims.mass.printed", "many"]),
        ("printed: 1349", "printed: 1e3", ["claims.mass.printed", "as in 0.03 or 1.0e+5"]),
        ("kind: monte_carlo", "kind: context\n    input: a.b", ["claims.mass.input: only a claim of kind 'input'"]),
        ("id: mass", "id: a mass", [":3: claims.a mass.id"]),
        ("claims:", "claims: [", ["paper.yaml"]),
    ],
)
def test_a_malformed_file_is_refused_by_file_id_and_key(tmp_path, old, new, words):
    assert load(tmp_path, ENTRY)
    assert load(tmp_path, ENTRY.replace("monte_carlo", "input\n    input: a.b"))[0].input == "a.b"
    with pytest.raises(InputError) as error:
        load(tmp_path, ENTRY.replace(old, new, 1))
    for word in ["paper.yaml", *words]:
        assert word in str(error.value)


BENCHMARKS = """paper,quantity,value,unit,target,met
one,"a solve, from nothing",0.25,s,< 1,yes
other,"a solve, from nothing",4,s,,
one,paper over ours,5.39e7,ratio,,
"""


def measured(tmp_path, text, paper="one"):
    path = tmp_path / "benchmarks.csv"
    path.write_text(text)
    return load_measured(path, paper)


def test_the_measured_rows_of_one_paper_load(tmp_path):
    assert measured(tmp_path, BENCHMARKS) == {"a solve, from nothing": 0.25, "paper over ours": 5.39e7}
    assert measured(tmp_path, BENCHMARKS, "other") == {"a solve, from nothing": 4.0}
    assert measured(tmp_path, BENCHMARKS, "a third") == {}


@pytest.mark.parametrize(("old", "new"), [("0.25", "fast"), (",0.25,s,< 1,yes", "")])
def test_benchmarks_that_cannot_be_read_are_refused_by_file(tmp_path, old, new):
    with pytest.raises(InputError, match=r"benchmarks\.csv.*make bench"):
        measured(tmp_path, BENCHMARKS.replace(old, new, 1))


# ---------------------------------------------------------------------------------------------------- verdict rules


def test_a_deterministic_scalar_reproduces_within_the_printed_rounding():
    assert [verdict(claim(), value) for value in (1349.5, 1348.5)] == ["reproduced", "reproduced"]
    assert [verdict(claim(), value) for value in (1349.5001, 1348.4999)] == ["differs", "differs"]


def test_the_rounding_edge_tolerates_floating_point_noise_and_no_more():
    small = claim(printed=0.3, resolution=0.1)
    assert verdict(small, 0.1 + 0.15) == "reproduced"  # 0.25 exactly on the edge, in binary a little off
    assert verdict(small, 0.25 - 1e-8) == "differs"
    huge = claim(printed=4.2828e13, resolution=1e9)
    assert verdict(huge, 4.2828e13 + 0.5e9) == "reproduced"
    assert verdict(huge, 4.2828e13 + 0.5e9 + 1e3) == "differs"


def test_every_component_of_a_deterministic_vector_must_reproduce():
    vector = claim(printed=[1.0, 20.0], resolution=[0.1, 10.0])
    assert verdict(vector, [1.05, 25.0]) == "reproduced"
    assert verdict(vector, [1.051, 20.0]) == "differs"
    assert verdict(vector, [1.0, 14.99]) == "differs"
    assert verdict(claim(printed=[1.0, 20.0], resolution=0.1), np.array([1.04, 19.96])) == "reproduced"
    matrix = claim(printed=[[1, 2], [3, 4]], resolution=1)
    assert verdict(matrix, [[1.4, 2.4], [3.4, 4.5]]) == "reproduced"
    assert verdict(matrix, [[1.4, 2.4], [3.4, 4.6]]) == "differs"


def test_monte_carlo_adds_half_a_digit_to_three_standard_errors_of_ours_and_the_papers():
    printed = claim(kind="monte_carlo", trials=500, resolution=1.0)
    our_error = 0.3  # with 2000 trials: the paper's 500 have twice the error
    combined = math.hypot(our_error, 2 * our_error)
    edge = 0.5 + 3 * combined
    for sign in (+1, -1):
        inside = judge(printed, Evaluation(1349 + sign * (edge - 1.01 * our_error), our_error, 2000))
        assert inside.verdict == "reproduced"
        assert inside.margin.value == pytest.approx(sign * (edge - 1.01 * our_error))
        assert inside.margin.distance == pytest.approx(1.01 * our_error / combined)
        assert judge(printed, Evaluation(1349 + sign * (edge + 1.01 * our_error), our_error, 2000)).verdict == "differs"


def test_within_one_of_our_errors_of_the_limit_more_trials_would_decide():
    printed = claim(kind="monte_carlo", trials=500, resolution=1.0)
    our_error, far = 0.3, 0.5 + 3 * 0.3 * math.sqrt(5)
    judged = judge(printed, Evaluation(1349 + far + 0.5 * our_error, our_error, 2000))
    assert judged.verdict == "undetermined"
    number = judged.doubts[0].trials
    # With so many trials and the same value it is decided.
    settled = judge(
        printed, Evaluation(1349 + far + 0.5 * our_error, our_error * math.sqrt(2000 / number), int(number))
    )
    assert settled.verdict == "differs"
    assert number < 20_000


def test_what_zero_would_reproduce_as_well_is_undetermined():
    """Covariances that are noise; a row with one number that is not, and a printed zero, are decided."""
    noise = claim(kind="monte_carlo", printed=[-0.05, 0.03], trials=500, resolution=0.01)
    errors, trials = [0.001, 0.001], 500_000
    judged = judge(noise, Evaluation([0.001, -0.002], errors, trials))
    assert judged.verdict == "undetermined" and "zero" in judged.doubts[0].why and judged.doubts[0].trials is None
    assert judge(noise, Evaluation([0.2, 0.0], errors, trials)).verdict == "differs"
    for printed in ([-0.05, 3.0], [0.0, 0.0]):
        row = claim(kind="monte_carlo", printed=printed, trials=500, resolution=0.01)
        assert judge(row, Evaluation(printed, errors, trials)).verdict == "reproduced"


def test_a_number_without_a_standard_error_decides_nothing():
    printed = claim(kind="monte_carlo", trials=500, resolution=1.0)
    judged = judge(printed, Evaluation(1349.0, math.nan, 7))
    assert (judged.verdict, judged.margin) == ("undetermined", None)
    assert judged.doubts == (Doubt(why="so few trials give no standard error"),)
    both = printed.model_copy(update={"printed": [1349, 1349]})
    assert judge(both, Evaluation([1349.0, 9.0], [math.nan, 0.1], 7)).verdict == "differs"


def test_every_component_of_a_monte_carlo_vector_has_a_verdict_and_the_worst_is_named():
    printed = claim(kind="monte_carlo", printed=[100.0, 50.0, 0.0], trials=1000, resolution=0.001)
    errors = [1.0, 0.1, 0.01]
    edge = [0.0005 + 3 * math.sqrt(2) * e for e in errors]
    inside = judge(printed, Evaluation([100.0, 50 - 0.7 * edge[1], 0.5 * edge[2]], errors, 1000))
    assert (inside.verdict, inside.margin.value) == ("reproduced", pytest.approx(-0.7 * edge[1]))
    outside = judge(printed, Evaluation([100.0, 50.0, 1.4 * edge[2]], errors, 1000))
    assert (outside.verdict, outside.margin.value) == ("differs", 1.4 * edge[2])
    assert outside.components == ["reproduced", "reproduced", "differs"]
    mixed = judge(printed, Evaluation([100.0, 50.0, edge[2]], errors, 1000))
    assert (mixed.verdict, mixed.components) == ("undetermined", ["reproduced", "reproduced", "undetermined"])
    matrix = claim(kind="monte_carlo", printed=[[1.0, 2.0]], trials=10, resolution=0.1)
    judged = judge(matrix, Evaluation([[1.0, 9.0]], [[0.1, 0.1]], 10))
    assert (judged.margin.value, judged.components) == (7.0, [["reproduced", "differs"]])


def test_what_cannot_fail_is_by_construction():
    statement = claim(kind="qualitative", printed=True, resolution=None)
    identity = Declaration(by_construction="an identity")
    assert judge(statement, Evaluation(True, evidence="yes"), identity).verdict == "by_construction"
    assert judge(statement, Evaluation(False, evidence="no"), identity).verdict == "fails"
    assert judge(claim(), Evaluation(1349, by_construction="it is an input here")).verdict == "by_construction"
    wrong = Evaluation(False, evidence="no", by_construction="a number of monomials")
    assert judge(statement, wrong).verdict == "by_construction"
    assert judge(statement, replace(wrong, failed=True)).verdict == "fails"


def test_a_statement_in_doubt_is_undetermined():
    statement = claim(kind="qualitative", printed=True, resolution=None)
    doubts = (Doubt(why="noise decides"),)
    judged = judge(statement, Evaluation(True, evidence="yes", doubts=doubts))
    assert (judged.verdict, judged.doubts) == ("undetermined", doubts)


def test_close_is_a_tolerance_stated_beforehand():
    printed = claim(printed=-200.0, resolution=0.1)
    assert verdict(printed, -200.04, close=CLOSE) == "reproduced"
    assert verdict(printed, -201.999, close=CLOSE) == "close"
    assert verdict(printed, -198.001, close=CLOSE) == "close"
    assert verdict(printed, -202.001, close=CLOSE) == "differs"
    assert verdict(printed, -200.5, close=Tolerance(reason="why", absolute=0.5)) == "close"
    assert verdict(printed, -200.501, close=Tolerance(reason="why", absolute=0.5)) == "differs"
    vector = claim(printed=[1.0, 0.0], resolution=0.01)
    assert verdict(vector, [1.1, 0.2], close=Tolerance(reason="why", absolute=[0.1, 0.2])) == "close"
    assert verdict(vector, [1.1, 0.21], close=Tolerance(reason="why", absolute=[0.1, 0.2])) == "differs"
    assert verdict(vector, [1.001, 0.02], close=Tolerance(reason="a zero leaves no room", relative=0.5)) == "differs"
    noisy = claim(kind="monte_carlo", trials=100, resolution=1.0)
    assert verdict(noisy, 1360.0, 0.1, 100, close=CLOSE) == "close"
    with pytest.raises(ArtifactError, match="tolerance"):
        verdict(vector, [2.0, 2.0], close=Tolerance(reason="why", absolute=[0.1]))


@pytest.mark.parametrize(
    ("printed", "computed", "expected"),
    [(True, True, "holds"), (True, False, "fails"), (False, False, "holds"), (False, True, "fails")],
)
def test_a_statement_holds_if_the_test_decides_as_printed(printed, computed, expected):
    statement = claim(kind="qualitative", printed=printed, resolution=None)
    assert verdict(statement, computed, evidence="factor 0.011") == expected
    assert verdict(statement, np.bool_(computed), evidence="factor 0.011") == expected


def test_inputs_are_as_stated_only_if_used_literally():
    speed = claim(kind="input", printed=6.1, resolution=0.1)
    assert verdict(speed, 6.1 * (1 + 1e-12)) == "as_stated"
    assert verdict(speed, 6.1001) == "not_as_stated"  # within the rounding, and yet not what is stated
    infinite = claim(kind="input", printed=[0, math.inf])
    assert verdict(infinite, [0.0, math.inf]) == "as_stated"
    for finite in (1e7, 1e308, -math.inf, math.nan, None):
        assert verdict(infinite, [0.0, finite]) == "not_as_stated"
    assert verdict(claim(kind="input", printed=True, resolution=None), False) == "not_as_stated"
    assert verdict(claim(kind="input", printed="ZEM", resolution=None), "ZEM") == "as_stated"
    assert verdict(claim(kind="input", printed=1, resolution=None), True) == "not_as_stated"


def test_a_value_that_is_not_finite_never_reproduces():
    assert verdict(claim(), math.nan) == "differs"
    assert verdict(claim(), math.inf, close=Tolerance(reason="why", relative=1.0)) == "differs"
    judged = judge(claim(kind="monte_carlo", trials=10), Evaluation(math.nan))
    assert (judged.verdict, judged.margin.value) == ("differs", None)


@pytest.mark.parametrize(
    ("changes", "evaluation", "word"),
    [
        ({}, Evaluation([1.0]), "shape"),
        ({}, Evaluation(True), "numbers"),
        ({"kind": "qualitative", "printed": True}, Evaluation(1), "true or false"),
        ({"kind": "monte_carlo", "trials": 10}, Evaluation(1.0, None, 10), "standard error"),
        ({"kind": "monte_carlo", "trials": 10}, Evaluation(1.0, 0.1), "trials"),
        ({"kind": "monte_carlo", "trials": 10}, Evaluation(1.0, -0.1, 10), "standard error"),
        ({"kind": "monte_carlo", "trials": 10}, Evaluation(1.0, 0.1, 0), "trials"),
    ],
)
def test_an_unusable_evaluation_is_refused_by_name(changes, evaluation, word):
    with pytest.raises(ArtifactError, match=rf"paper: claim mass: .*{word}"):
        judge(claim(**changes), evaluation)


# ---------------------------------------------------------------------------------------------------- collecting

CLAIMS = [
    claim(),
    claim(id="converges", kind="qualitative", printed=True, resolution=None, unit="1"),
    claim(id="isp", kind="input", printed=210, unit="s"),
    claim(id="effort", kind="undetermined", printed=[12, 32], unit="h, cores"),
    claim(id="msl", kind="context", printed=20, unit="km"),
    claim(id="mean", kind="monte_carlo", printed=[100.1, 49.8], resolution=0.1, trials=2000, unit="m"),
]
DECLARED = {
    "mean": Declaration(
        "The step is too long: {value[1]:.2f} m ({trials} trials); {target4.value[1]:.1f} m.", ("E11",)
    ),
    "mass": Declaration("{printed.prior:.1f} kg against {prior:.1f} kg.", errata=("E5", "E17")),
}


def evaluations(**changes):
    values = {
        "mass": Evaluation(1349.4, numbers={"prior": 1349.44}),
        "converges": Evaluation(True, evidence="largest factor 0.011."),
        "isp": Evaluation(210.0),
        "effort": None,
        "mean": Evaluation([100.0, 50.0], [0.05, 0.01], 2000),
    }
    return {**values, **changes}


def readings():
    return {
        "printed": evaluations(mass=Evaluation(1355.0, numbers={"prior": np.float64(1354.9)})),
        "corrected": evaluations(isp=Evaluation(211)),
        "target4": evaluations(converges=None),
    }


def collected():
    return collect(CLAIMS, DECLARED, readings(), known_errata=["E5", "E11", "E17"])


def test_rows_show_the_default_reading_first_and_keep_every_reading():
    rows = {row.id: row for row in collected()}
    assert list(rows) == [c.id for c in CLAIMS]
    mass = rows["mass"]
    assert (mass.verdict, mass.reading) == ("reproduced", "corrected")
    assert list(mass.readings) == ["corrected", "printed", "target4"]
    assert mass.readings["printed"].verdict == "differs"
    assert mass.reason == "E5, E17. 1354.9 kg against 1349.4 kg."
    assert rows["converges"].readings["target4"].verdict is None
    assert rows["effort"].verdict == "undetermined"
    assert rows["msl"].verdict == "quoted"
    # an input is checked in the reading that must use it, and visibly not in the others
    assert (rows["isp"].verdict, rows["isp"].reading) == ("as_stated", "printed")
    assert rows["isp"].readings["corrected"].verdict == "not_as_stated"
    mean = rows["mean"]
    assert mean.verdict == "differs"
    assert mean.readings["corrected"].components == ["reproduced", "differs"]
    assert mean.reason.startswith("E11. The step is too long: 50.00 m (2000 trials)")
    assert mean.reason.endswith("; 50.0 m.")


def test_a_row_has_all_that_is_printed_and_declared_of_its_claim():
    printed = claim(kind="monte_carlo", trials=2000, note="rounded", plain="the final mass", headline=3)
    declared = Declaration("It differs.", ("E5",), ("form",), Tolerance(reason="a digit", absolute=1.0))
    (row,) = collect([printed], {"mass": declared}, {"corrected": {"mass": Evaluation(1360.0, 0.1, 2000)}})
    for source in (printed, declared):
        shared = vars(source).keys() & Claim.model_fields.keys() - {"reason", "by_construction", "counterexample"}
        assert {name: getattr(row, name) for name in shared} == {name: getattr(source, name) for name in shared}
    unset = {name for name, of in Claim.model_fields.items() if getattr(row, name) == of.default}
    assert unset == {"size", "by_construction", "counterexample", "universes", "thin"}


def evaluations_of(name, **options):
    return {name: replace(evaluations()[name], **options)}


@pytest.mark.parametrize(
    "declaration",
    [None, Declaration(), Declaration("It just differs."), Declaration("", ("E1",)), Declaration(" ", choices=("h",))],
)
@pytest.mark.parametrize("name", ["mass", "converges"])
def test_differs_and_fails_need_a_reason_with_an_erratum_or_a_choice(name, declaration):
    published = [c for c in CLAIMS if c.id == name]
    bad = Evaluation(1300.0) if name == "mass" else Evaluation(False, evidence="factor 1.2.")
    declared = {} if declaration is None else {name: declaration}
    with pytest.raises(InputError, match=rf"claim {name}: .*without a reason"):
        collect(published, declared, {"corrected": {name: bad}})
    for good in (Declaration("Because.", ("E1",)), Declaration("Because.", choices=("step",))):
        assert collect(published, {name: good}, {"corrected": {name: bad}})[0].verdict in ("differs", "fails")
    # only the verdict that is shown first must be explained
    fine = evaluations_of(name)
    assert collect(published, declared, {"corrected": fine, "printed": {name: bad}})


def test_a_claim_without_a_reason_says_which_choices_it_depends_on():
    named, silent = Declaration(choices=("noise_unit", "step")), Declaration("Because.", choices=("step",))
    reasons = [
        collect([CLAIMS[0]], {"mass": declared}, {"corrected": evaluations_of("mass")})[0].reason
        for declared in (named, silent)
    ]
    assert reasons == ["Depends on noise unit, step.", "Because."]


def test_a_reason_has_dashes_for_numbers_that_a_smaller_size_does_not_build():
    declared = {"mass": Declaration("Here {value:.0f}, there {elsewhere.value[0]:.2f}.", ("E1",))}
    evaluations = {"corrected": {"mass": Evaluation(1355.0)}}
    (row,) = collect([CLAIMS[0]], declared, evaluations, left_out=["elsewhere"])
    assert row.reason == "E1. Here 1355, there –."
    with pytest.raises(InputError, match="elsewhere"):
        collect([CLAIMS[0]], declared, evaluations)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r, d: [of.pop("mass") for of in r.values()], ["claim mass", "no function evaluates it"]),
        (lambda r, d: r["target4"].update(mas=None), ["there is no claim 'mas'", "'mass'"]),
        (lambda r, d: r["corrected"].update(mass=None), ["claim mass", "not evaluated in reading corrected"]),
        (lambda r, d: d.update(mass=Declaration("{priors:.1f}")), ["claim mass", "priors"]),
        (lambda r, d: d.update(mass=Declaration("why", ("E99",))), ["there is no erratum 'E99'"]),
        (lambda r, d: d.update(converges=Declaration(close=CLOSE)), ["claim converges", "no tolerance"]),
    ],
)
def test_mistakes_of_a_paper_are_named(change, words):
    evaluations, declared = readings(), dict(DECLARED)
    change(evaluations, declared)
    with pytest.raises(InputError) as error:
        collect(CLAIMS, declared, evaluations, known_errata=["E5", "E11", "E17"])
    for word in ["paper", *words]:
        assert word in str(error.value)


# ---------------------------------------------------------------------------------------------------- files and tables


def test_json_is_deterministic_complete_and_without_nan(tmp_path):
    evaluations = readings()
    evaluations["printed"]["mass"] = Evaluation(np.float64("nan"), numbers={"prior": math.nan})
    evaluations["printed"]["mean"] = Evaluation([math.inf, 1 / 3], [math.nan, 0.1], np.int64(2000))
    rows = collect([*CLAIMS, claim(id="weights", kind="input", printed=[0, math.inf])], DECLARED, {
        name: {**values, "weights": Evaluation([0, math.inf])} for name, values in evaluations.items()
    })  # fmt: skip
    paths = tmp_path / "a" / "claims.json", tmp_path / "b.json"
    for path in paths:
        write_claims(rows, path)
    content = paths[0].read_bytes()
    assert content == paths[1].read_bytes()
    assert content.endswith(b"]\n")
    assert not any(word in content for word in (b"NaN", b"Infinity"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b.json"]
    back = read_claims(paths[0])
    assert back == rows
    by_id = {row.id: row for row in back}
    assert by_id["mass"].readings["printed"].value is None
    assert by_id["mass"].readings["printed"].verdict == "differs"
    assert by_id["mean"].readings["printed"].value == [None, 1 / 3]  # no digit is lost
    assert by_id["weights"].printed == [0, "inf"]
    assert by_id["weights"].verdict == "as_stated"


def test_a_bad_row_leaves_the_good_file_alone(tmp_path):
    path = tmp_path / "claims.json"
    write_claims(collected(), path)
    before = path.read_bytes()
    damaged = collected()[0].model_copy(update={"printed": math.nan})
    with pytest.raises(ArtifactError, match=r"claims.json"):
        write_claims([damaged], path)
    assert path.read_bytes() == before


def test_inputs_and_quotations_are_never_counted():
    counts = counted(collected()).verdicts
    assert list(counts["counted"]) == list(COUNTED_VERDICTS)
    assert counts["counted"] == {
        "reproduced": 1, "close": 0, "differs": 1, "holds": 1, "fails": 0, "undetermined": 1,
    }  # fmt: skip
    assert counts["listed"] == {"as_stated": 1, "not_as_stated": 0, "quoted": 1, "by_construction": 0}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((1349.3841, 0.0468), "1349.384 ± 0.047"),
        ((-0.0047, 0.0056), "-0.0047 ± 0.0056"),
        ((1.23e-5, 2e-7), "(1.230 ± 0.020)e-5"),
        ((123456.0, 2345.0), "123456 ± 2345"),
        ((4.85e-4, None, 1e-6), "4.85e-4"),
        ((4.2828e13, None, 1e9), "4.2828e13"),
        ((2 / 3,), "0.666667"),
        ((None,), "–"),
    ],
)
def test_numbers_are_written_as_a_reader_expects(arguments, expected):
    assert format_number(*arguments) == expected


def test_damaged_claims_are_refused_with_a_remedy(tmp_path):
    path = tmp_path / "claims.json"
    for content, problem in (("", "Invalid JSON"), ("{}", "Input should be a valid"), ('[{"id": 1}]', "0.paper: ")):
        path.write_text(content, encoding="utf-8")
        with pytest.raises(ArtifactError) as caught:
            read_claims(path)
        assert str(caught.value).startswith(f"{path}: {problem}")
        assert str(caught.value).endswith("; delete the file and run 'snakemake claims'")
