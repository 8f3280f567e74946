# The stages of all papers: one rule for each stage of a catalogue. Monte Carlo cases of few trials are flown together, by
# one job of a reading (flights); any other that is not scattered is one job (montecarlo); a scattered one has a job for
# each chunk (montecarlo_chunk) and one that gathers them (montecarlo_gather).
NAMES = {CHUNK: "chunks/{case}.{chunk}of{chunks}", **dict.fromkeys((FLIGHTS, GATHER), f"{FLIGHTS}.{{case}}")}


def stage_rules(paper):
    """Name, stage and artifacts of each rule of a paper, and the readings that it is for."""
    together = [(cases, "|".join(readings)) for cases, readings in SHARED[paper].flown_together().items()]
    flown = [rf"({readings})/{FLIGHTS}\.({'|'.join(cases)})\.h5" for cases, readings in together]
    others = f"(?!{'|'.join(flown) or '(?!)'})[a-z0-9_]+"
    for number, (cases, readings) in enumerate(together):
        name = f"flights_{number}" if number else "flights"
        yield name, FLIGHTS, [f"{FLIGHTS}.{case}" for case in cases], readings
    for stage in PAPERS[paper].stages:
        yield stage, stage, [NAMES.get(stage, stage)], others if stage == FLIGHTS else "[a-z0-9_]+"


def flown_as(paper, stage):
    """The Monte Carlo cases that a rule flies: those that are scattered, or the others."""
    return [case for case in MODELS[paper].CASES if (case in SHARED[paper].scattered) == (stage != FLIGHTS)]


def stage_input(paper, stage):
    """Input files of a stage, by the name of its function's parameter."""

    def named(wildcards):
        taken = files(paper, wildcards.reading, PAPERS[paper].stages[stage].needs)
        return taken | (dict(chunks=chunk_files(paper, wildcards)) if stage == GATHER else {})

    return named


def chunk_files(paper, wildcards):
    """The files of all chunks of a Monte Carlo case."""
    chunks = SHARED[paper].chunks(wildcards.reading, wildcards.case)
    return [f"data/cache/{paper}/{wildcards.reading}/{chunk}.h5" for chunk in chunks]


def made(paths):
    """The recipes of artifacts, without what they are made from: Snakemake follows that itself."""
    recipes = (recipe(path)[2] for path in paths)
    return [{key: value for key, value in recipe.items() if key != "needs"} for recipe in recipes]


def stage_params(paper, stage, outputs):
    """The params of a stage's rule; chunks are temporary and leave no record, so that what gathers them has theirs."""
    return dict(
        paper=paper,
        entries=PAPERS[paper].stages[stage].entries,
        recipes=lambda wildcards: made(filled(path, wildcards) for path in outputs),
        chunks=lambda wildcards: made(chunk_files(paper, wildcards)) if stage == GATHER else [],
        build=build,
    )


for _paper in PAPERS:

    rule:
        name:
            _paper
        input:
            products(_paper),

    for _name, _stage, _artifacts, _readings in stage_rules(_paper):
        _outputs = [f"data/cache/{_paper}/{{reading}}/{artifact}.h5" for artifact in _artifacts]

        rule:
            name:
                f"{_paper}_{_name}"
            input:
                unpack(stage_input(_paper, _stage)),
            output:
                [temp(path) if _stage == CHUNK else path for path in _outputs],
            log:
                f"logs/{_paper}/{{reading}}/{NAMES.get(_name, _name)}.log",
            benchmark:
                f"benchmarks/{_paper}/{{reading}}/{NAMES.get(_name, _name)}.tsv"
            wildcard_constraints:
                reading=_readings,
                case="|".join(flown_as(_paper, _stage)) or "(?!)",
            priority: PAPERS[_paper].stages[_stage].priority
            conda:
                "../envs/marsedl.yaml"
            params:
                **stage_params(_paper, _stage, _outputs),
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
