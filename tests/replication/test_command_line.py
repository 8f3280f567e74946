"""What is asked of Snakemake: what something makes is accepted, anything else is one message with the nearest name."""

import os
import re
import string
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication import command_line
from marsedl.replication.command_line import (
    asked_for,
    check_configuration,
    check_folders,
    check_request,
    check_target,
    configuration,
)
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs import load_studies

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"
COMPARISONS = comparisons()
PAPERS = {slug: catalogue(slug) for slug in SLUGS}
MODELS = {slug: input_model(slug) for slug in SLUGS}
STUDIES = load_studies(MODELS, CONFIGS, {"chunks": 2})


def check(target, studies=STUDIES):
    check_target(target, "full", PAPERS, studies, COMPARISONS)


def refused(target, *fragments, studies=STUDIES):
    with pytest.raises(InputError) as caught:
        check(target, studies)
    message = str(caught.value)
    assert message.startswith(f"{target}: ")
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message
    return message


# ------------------------------------------------------------------------------------------------ configuration files


@pytest.mark.parametrize(
    ("arguments", "settings", "files"),
    [
        (["all"], [], []),
        (["all", "--configfile", "mine.yaml"], [], ["mine.yaml"]),
        (["all", "--configfiles", "a.yaml", "b.yaml", "--cores", "2"], [], ["a.yaml", "b.yaml"]),
        (["--configfile=mine.yaml", "all"], [], ["mine.yaml"]),
        (["--configfile", "mine.yaml", "figures/a/b.png"], [], ["mine.yaml", "figures/a/b.png"]),
        (["--configfile", "mine.yaml", "--", "all"], [], ["mine.yaml"]),
        (["--configfile", "a.yaml", "-n", "--configfile", "b.yaml"], [], ["b.yaml"]),
        (["all", "--config", "size=smoke", "chunks=3", "-n"], ["size=smoke", "chunks=3"], []),
        (["-C", "size=smoke", "all"], ["size=smoke", "all"], []),
        (["all", "--", "--configfile", "mine.yaml"], [], []),
    ],
)
def test_settings_are_those_that_snakemake_takes_for_such(arguments, settings, files):
    assert configuration(arguments) == (settings, files)


@pytest.mark.parametrize(
    ("content", "fragments"),
    [
        (None, ["cannot be read (No such file or directory)", "check its path"]),
        (b"", ["must be keys with values, not nothing"]),
        ("size: smoke\n".encode("utf-16"), ["line 1: not UTF-8"]),
        (b"__use_yte__: true\nsize: smoke\n", ["__use_yte__: unknown key"]),
    ],
)
def test_a_configuration_file_that_is_none_ends_in_one_message(tmp_path, content, fragments):
    path = tmp_path / "mine.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SystemExit) as caught:
        check_configuration(["all", "--configfile", str(path)], SLUGS)
    assert re.match(rf"\nmarsedl: {re.escape(str(path))}(:\d+)?: ", str(caught.value.code))
    for fragment in fragments:
        assert fragment in str(caught.value.code)


def test_a_configuration_file_in_order_is_passed_on(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("size: smoke\nchunks: 2\nfunnels: {readings: {}}\n", encoding="utf-8")
    check_configuration(["all", "--configfile", str(path)], SLUGS)


@pytest.mark.parametrize("made_before", [False, True])
def test_a_target_behind_the_option_is_not_read_as_a_configuration(made_before, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if made_before:
        Path("fig07.png").write_bytes(b"\x89PNG")
    for target in ("fig07.png", "all"):
        with pytest.raises(SystemExit, match=rf"{target}: .* write targets before --configfile"):
            check_configuration(["--configfile", target], SLUGS)


def test_a_target_behind_settings_is_told_from_one():
    with pytest.raises(SystemExit, match=r"--config all: is not NAME=VALUE; .*: snakemake all --config"):
        check_configuration(["--config", "size=smoke", "all"], SLUGS)
    check_configuration(["all", "--config", "size=smoke"], SLUGS)


def documented():
    """Every command in the pages, and in what the project says, that starts Snakemake."""
    for path in [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md")), *sorted(ROOT.glob("src/**/*.py"))]:
        for line in path.read_text(encoding="utf-8").splitlines():
            for command in re.findall(r"(?:^|[\"'` ])snakemake( [^\"'`#]*)", line):
                if "--config" in command or "--configfile" in command:
                    yield pytest.param(command.split(), id=f"{path.name}: {command.strip()}")


@pytest.mark.parametrize("arguments", list(documented()))
def test_documented_commands_name_their_targets_where_snakemake_looks_for_them(arguments):
    settings, files = configuration(arguments)
    assert all("=" in setting for setting in settings if setting != "...")
    assert all(path.endswith(".yaml") for path in files)


# ------------------------------------------------------------------------------------------------------------- targets

GOOD = [
    "report/index.html",
    "report/claims.json",
    "report/badge.json",
    "report/digests.json",
    "report/claims/funnels.json",
    "report/counterexamples/funnels.json",
    *(f"figures/comparison/{stem}.{suffix}" for stem in COMPARISONS for suffix in ("png", "pdf", "csv", "md")),
    *(
        f"figures/{slug}/{reading}{stem}.{suffix}"
        for slug, paper in PAPERS.items()
        for reading in ("", "corrected/", "printed/")
        for kind, suffixes in ((paper.figures, ("png", "pdf")), (paper.tables, ("csv", "md")))
        for stem in kind
        for suffix in suffixes
    ),
    *(f"figures/{slug}/{stem}.md" for slug, paper in PAPERS.items() for stem in [*paper.summaries, "claims"]),
    *(
        f"data/cache/{slug}/printed/{stage}.h5"
        for slug, paper in PAPERS.items()
        for stage in paper.stages
        if not stage.startswith("montecarlo")
    ),
    "data/cache/powered_descent/corrected/montecarlo.closed_loop_large.h5",
    "data/cache/powered_descent/corrected/chunks/closed_loop.0of2.h5",
    "data/cache/powered_descent/corrected/chunks/closed_loop.1of2.h5",
]


def test_what_something_makes_is_accepted():
    for target in GOOD:
        check(target)


@pytest.mark.parametrize(
    ("target", "fragments"),
    [
        ("figures/powerd_descent/fig07.png", ["no paper 'powerd_descent'; did you mean 'powered_descent'?"]),
        ("figures/comparisn/costs.png", ["no paper 'comparisn'; did you mean 'comparison'?"]),
        ("figures/comparison/accuracies.png", ["no comparison 'accuracies'", "'accuracy'?"]),
        ("figures/powered_descent/fig7.png", ["no figure or table 'fig7'; did you mean 'fig07'?"]),
        ("figures/powered_descent/printed/fig7.png", ["no figure or table 'fig7'; did you mean 'fig07'?"]),
        ("figures/powered_descent/printd/fig07.png", ["no reading 'printd'; did you mean 'printed'?", "--configfile"]),
        ("figures/powered_descent/fig07.svg", ["'fig07' is written as .png and .pdf"]),
        ("figures/powered_descent/printed/claims.csv",
         ["one table of all readings", "figures/powered_descent/claims.csv"]),
        ("figures/powered_descent/printed/more/fig07.png", ["no figure or table 'more/fig07'"]),
        ("figures/powered_descent", ["is a folder; name a file in it", "powered_descent"]),
        ("figures", ["is a folder; name a file in it"]),
        ("data/cache/powered_descent/nominal.h5", ["ask for data/cache/powered_descent/corrected/nominal.h5"]),
        ("data/cache/powered_descent/corected/nominal.h5", ["no reading 'corected'; did you mean 'corrected'?"]),
        ("data/cache/powered_descent/corrected/nominl.h5", ["no artifact 'nominl'; did you mean 'nominal'?"]),
        ("data/cache/powered_descent/corrected/nominal.hdf", ["'nominal' is written as .h5"]),
        ("data/cache/powered_descent/corrected/montecarlo.h5", ["no artifact 'montecarlo'"]),
        ("data/cache/powered_descent/corrected/montecarlo.closedloop.h5", ["did you mean 'montecarlo.closed_loop'?"]),
        ("data/cache/powered_descent/corrected/chunks/closed_loop.7of3.h5", ["are 0of2 to 1of2", "--config chunks=N"]),
        ("data/cache/powered_descent/corrected/chunks/closed_loop.0of0.h5", ["are 0of2 to 1of2"]),
        ("data/cache/powered_descent/corrected/chunks/closed_loop.00of2.h5", ["are 0of2 to 1of2"]),
        ("data/cache/powered_descent/corrected/chunks/closed_loop.2of2.h5", ["are 0of2 to 1of2"]),
        ("data/cache/powered_descent/corrected/chunks/closed_lop.0of2.h5", ["did you mean 'closed_loop'?"]),
        ("data/cache/powered_descent/corrected/chunks/closed_loop.h5", ["not a chunk of a Monte Carlo case"]),
        ("data/cache/powered_descent/printed/montecarlo.closed_loop_large.h5",
         ["closed_loop_large, which flies no trials in the reading printed", "set ensemble.large_trials above 0"]),
        ("data/cache/powered_descent/printed/chunks/closed_loop_large.0of1.h5", ["closed_loop_large", "no trials"]),
        ("report/indx.html", ["did you mean 'report/index.html'?"]),
        ("report/claims/funels.json", ["did you mean 'report/claims/funnels.json'?"]),
        ("build/smoke/figures/powered_descent/fig07.png",
         ["snakemake figures/powered_descent/fig07.png --config size=smoke"]),
        ("build/check/data/cache/funnels/corrected/funnel.h5",
         ["snakemake data/cache/funnels/corrected/funnel.h5 --config size=check"]),
        (str(Path("figures/powered_descent/fig07.png").absolute()), ["absolute path", "relative to the project"]),
    ],
)  # fmt: skip
def test_what_nothing_makes_is_refused_with_the_nearest(target, fragments):
    refused(target, *fragments)


def test_a_product_behind_which_a_case_flies_no_trials_is_refused():
    """Also if other artifacts stand between."""
    paper = PAPERS["powered_descent"]
    reading = STUDIES["powered_descent"].readings["printed"]
    ensemble = reading.inputs.ensemble.model_copy(update={"trials": 0})
    mine = replace(reading, name="mine", inputs=reading.inputs.model_copy(update={"ensemble": ensemble}))
    studies = STUDIES | {"powered_descent": replace(STUDIES["powered_descent"], readings={"mine": mine})}
    behind = [stem for stem, figure in paper.figures.items() if "montecarlo.closed_loop" in figure.needs]
    assert behind
    for stem in behind:
        refused(f"figures/powered_descent/mine/{stem}.png", "flies no trials in the reading mine", studies=studies)
    check("data/cache/powered_descent/mine/gains.h5", studies)
    stages = paper.stages | {"study": replace(paper.stages["gains"], needs=("gains", "montecarlo.closed_loop"))}
    with pytest.raises(InputError, match="needs the Monte Carlo case closed_loop, which flies no trials"):
        command_line._check_trials("a target", ["study"], "full", replace(paper, stages=stages), mine)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_a_target_with_a_slip_in_it_is_refused_with_the_nearest_name(data):
    """A letter missing, doubled or exchanged in a name of a good target."""
    target = data.draw(st.sampled_from([good for good in GOOD if not good.startswith("report")]))
    folder = "figures" if target.startswith("figures") else "data/cache"
    names = target.removeprefix(f"{folder}/").split("/")
    place = data.draw(st.integers(0, len(names) - 1))
    stem, dot, rest = names[place].partition(".")
    at = data.draw(st.integers(0, len(stem) - 1))
    letter = data.draw(st.sampled_from(["", 2 * stem[at], *string.ascii_lowercase]))
    wrong = stem[:at] + letter + stem[at + 1 :]
    slug, paper = names[0], PAPERS.get(names[0])
    valid_names = {
        *(*PAPERS, "comparison", *COMPARISONS, "chunks", "montecarlo", "claims"),
        *((*paper.figures, *paper.tables, *paper.summaries, *paper.stages) if paper else ()),
        *((*STUDIES[slug].readings, *MODELS[slug].CASES) if paper else ()),
    }
    assume(wrong and wrong not in valid_names)
    names[place] = f"{wrong}{dot}{rest}"
    message = refused("/".join([folder, *names]))
    assert "did you mean" in message or "valid names" in message
    if place == 0:
        assert nearest(wrong, [*PAPERS, *(["comparison"] if folder == "figures" else [])]) in message


# ------------------------------------------------------------------------------------------------------ the whole line


@pytest.mark.parametrize(
    ("arguments", "targets"),
    [
        (["all", "--cores", "2"], []),
        (["figures/a/b.png", "-n"], ["figures/a/b.png"]),
        (["./figures/a//b.png"], ["figures/a/b.png"]),
        (["-n", "figures/a/b.png", "--config", "size=smoke"], ["figures/a/b.png"]),
        (["--forcerun", "data/cache/a/b/c.h5", "--", "report/a"], ["data/cache/a/b/c.h5", "report/a"]),
        (["build/smoke/figures/a/b.png"], ["build/smoke/figures/a/b.png"]),
        (["/project/figures/a/b.png"], ["/project/figures/a/b.png"]),
        (["/elsewhere/figures/a/b.png", "build/verify/0/figures/a/b.png"], []),
        (["--report", "report/out.html", "figures/a/b.png"], ["figures/a/b.png"]),
        (["--cleanup-metadata", "figures/a/b.png", "figures/a/c.png", "-n", "figures/d.png"], ["figures/d.png"]),
        (["all", "--configfile", "report/mine.yaml"], []),
    ],
)  # fmt: skip
def test_targets_are_the_arguments_that_look_like_products(arguments, targets):
    assert asked_for(arguments, Path("/project")) == targets


def request(root, *arguments):
    check_request(list(arguments), "full", PAPERS, STUDIES, COMPARISONS, ["all", "verify", "table"], root)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["powerd_descent", "--cores", "2"], "no target 'powerd_descent'; did you mean 'powered_descent'?"),
        (["--", "al"], "no target 'al'; did you mean 'all'?"),
        (["fig07.png"], "no target 'fig07.png'; valid names: all, claims"),
        ([""], r"a target is empty \(''\); name one"),
        (["-n", "--", ""], r"a target is empty \(''\); name one"),
        (["-n", "figures/powered_descent/fig7.png"], "did you mean 'fig07'"),
    ],
)
def test_what_no_rule_is_called_is_refused(tmp_path, arguments, message):
    with pytest.raises(InputError, match=message):
        request(tmp_path, *arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["all", "verify", "--cores", "all"],
        ["-n", "--until", "figure", "--executor", "local"],
        ["--snakefile", "Snakefile", "--target-jobs", "figure:paper=funnels,stem=fig04", "--mode", "subprocess"],
        ["logs/anything.log"],
    ],
)
def test_words_of_options_and_other_files_are_left_to_snakemake(tmp_path, arguments):
    request(tmp_path, *arguments)


# ------------------------------------------------------------------------------------------------------------- folders


def test_a_file_in_the_place_of_a_folder_is_refused(tmp_path):
    (tmp_path / "logs").write_text("")
    with pytest.raises(InputError, match=r"logs: is not a folder, .*; move it away"):
        check_folders(tmp_path, ["all"])
    check_folders(tmp_path, ["all", "-n"])
    (tmp_path / ".snakemake").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"\.snakemake: is not a folder"):
        check_folders(tmp_path, ["all", "-n"])
    check_folders(tmp_path, ["--lint"])


def test_a_folder_that_cannot_be_written_is_refused(tmp_path, monkeypatch):
    (tmp_path / "logs").mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "logs")  # permissions stop no root
    with pytest.raises(InputError, match=r"logs: this folder cannot be written; change its permissions"):
        check_folders(tmp_path, ["all"])
    check_folders(tmp_path, ["all", "-np"])


def test_a_full_disk_is_refused(tmp_path, monkeypatch):
    disk = os.statvfs(tmp_path)
    fields = ("f_frsize", "f_blocks", "f_bavail", "f_bfree")

    def with_free(blocks):
        values = dict(zip(fields, (4096, disk.f_blocks, blocks, blocks), strict=True))
        monkeypatch.setattr(os, "statvfs", lambda path: type("Disk", (), values))
        check_folders(tmp_path, ["all", "--dry-run"])

    with_free(1000)
    with pytest.raises(InputError, match=r"its disk is full \(4096 bytes are free\); delete something"):
        with_free(1)
