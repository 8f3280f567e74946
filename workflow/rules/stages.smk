# The stages of all papers: one rule for each stage of a catalogue. A Monte Carlo case that is not scattered is one job
# (montecarlo); any other has a job for each chunk (montecarlo_chunk) and one that gathers them (montecarlo_gather).

FLIGHTS = {
    "montecarlo": ("montecarlo.{case}", trial_options),
    "montecarlo_chunk": ("montecarlo.{case}.{chunk}of{chunks}", chunk_options),
    "montecarlo_gather": ("montecarlo.{case}", None),
}


def logged_as(stage):
    """The name of a stage's jobs among logs and benchmarks."""
    return FLIGHTS[stage][0] if stage in FLIGHTS else stage


def stage_input(paper, stage):
    """Input files of a stage, by the name of its function's parameter."""
    gathered = {"chunks": chunk_files(paper)} if stage == "montecarlo_gather" else {}
    return {**needs(paper, stage), **gathered}


def stage_output(paper, stage):
    """The artifact of a stage; chunks are temporary."""
    if stage == "montecarlo_chunk":
        return temp(cached(paper, "chunks/{case}.{chunk}of{chunks}"))
    return cached(paper, logged_as(stage))


def cases_of_stage(paper, stage):
    """Pattern of the cases that a stage flies or gathers."""
    if stage not in ("montecarlo", "montecarlo_gather"):
        return "[a-z_]+"
    return cases_of(paper, scattered=stage == "montecarlo_gather")


def trials_of(paper, stage):
    """Further params of a stage that flies or gathers trials."""
    if stage == "montecarlo_gather":
        return dict(chunks=gathered_from(paper, "montecarlo_chunk"))
    return dict(options=FLIGHTS[stage][1](paper)) if stage in FLIGHTS else {}


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
                **stage_input(_paper, _stage),
            output:
                stage_output(_paper, _stage),
            log:
                f"logs/{_paper}/{{reading}}/{logged_as(_stage)}.log",
            benchmark:
                f"benchmarks/{_paper}/{{reading}}/{logged_as(_stage)}.tsv"
            wildcard_constraints:
                case=cases_of_stage(_paper, _stage),
            priority: PAPERS[_paper].stages[_stage].priority
            conda:
                "../envs/marsedl.yaml"
            params:
                **stage(_paper, _stage),
                **trials_of(_paper, _stage),
            script:
                "../scripts/stage.py"
