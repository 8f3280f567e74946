# The stages of all papers: one rule for each stage of a catalogue. A Monte Carlo case that is not scattered is one job
# (montecarlo); any other has a job for each chunk (montecarlo_chunk) and one that gathers them (montecarlo_gather).

NAMES = {
    FLIGHTS: "montecarlo.{case}",
    CHUNK: "montecarlo.{case}.{chunk}of{chunks}",
    GATHER: "montecarlo.{case}",
}


def stage_input(paper, stage):
    """Input files of a stage, by the name of its function's parameter."""

    def named(wildcards):
        taken = files(paper, wildcards.reading, PAPERS[paper].stages[stage].needs)
        if stage == GATHER:
            taken["chunks"] = chunk_files(paper, wildcards.reading, wildcards.case)
        return taken

    return named


def stage_output(paper, stage):
    """The artifact of a stage; chunks are temporary."""
    if stage == CHUNK:
        return temp(
            f"data/cache/{paper}/{{reading}}/chunks/{{case}}.{{chunk}}of{{chunks}}.h5"
        )
    return f"data/cache/{paper}/{{reading}}/{NAMES.get(stage, stage)}.h5"


def stage_params(paper, stage):
    """The params of a stage's rule; chunks are temporary and leave no record, so that what gathers them has theirs."""
    declared = PAPERS[paper].stages[stage]
    simulated = PAPERS[paper].stages[CHUNK] if stage == GATHER else None

    def chunks(wildcards):
        return simulated and dict(
            inputs=given(paper, wildcards.reading, simulated.inputs),
            trials=cases(paper, wildcards.reading)[wildcards.case],
            code=code("stage.py", *simulated.entries),
            libraries=libraries("stage.py", *simulated.entries),
        )

    return dict(
        paper=paper,
        entries=declared.entries,
        inputs=lambda wildcards: given(paper, wildcards.reading, declared.inputs),
        options=lambda wildcards: flown(paper, stage, wildcards),
        chunks=chunks,
        code=code("stage.py", *declared.entries),
        libraries=libraries("stage.py", *declared.entries),
        build=build,
    )


for _paper in PAPERS:

    rule:
        name:
            _paper
        input:
            products(_paper),

    for _stage in PAPERS[_paper].stages:

        rule:
            name:
                f"{_paper}_{_stage}"
            input:
                unpack(stage_input(_paper, _stage)),
            output:
                stage_output(_paper, _stage),
            log:
                f"logs/{_paper}/{{reading}}/{NAMES.get(_stage, _stage)}.log",
            benchmark:
                f"benchmarks/{_paper}/{{reading}}/{NAMES.get(_stage, _stage)}.tsv"
            wildcard_constraints:
                case=(
                    "[a-z_]+"
                    if _stage not in (FLIGHTS, GATHER)
                    else cases_of(_paper, scattered=_stage == GATHER)
                ),
            priority: PAPERS[_paper].stages[_stage].priority
            conda:
                "../envs/marsedl.yaml"
            params:
                **stage_params(_paper, _stage),
            script:
                "../scripts/stage.py"


# An artifact that another reading owns: whoever asks for it by its path gets the owner's.
for _path in sys.argv[1:]:
    if _owned := command_line.owned_elsewhere(_path, SHARED):

        rule:
            name:
                _path
            input:
                _owned,

        print(f"{_path} is shared: it is {_owned}", file=sys.stderr)
