# The stages of all papers: one rule for each stage of a catalogue. Monte Carlo cases of few trials are flown together, by
# one job of a reading (flights); any other that is not scattered is one job (montecarlo); a scattered one has a job for
# each chunk (montecarlo_chunk) and one that gathers them (montecarlo_gather).
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
                changed=unproven(*_outputs),
            output:
                [temp(path) if _stage == CHUNK else path for path in _outputs],
            log:
                f"logs/{_paper}/{{reading}}/{LOGS.get(_name, _name)}.log",
            benchmark:
                f"benchmarks/{_paper}/{{reading}}/{LOGS.get(_name, _name)}.tsv"
            wildcard_constraints:
                reading=_readings,
                case="|".join(flown_as(_paper, _stage)) or "(?!)",
            priority: PAPERS[_paper].stages[_stage].priority
            conda:
                "../envs/marsedl.yaml"
            params:
                paper=_paper,
                entries=PAPERS[_paper].stages[_stage].entries,
                recipes=recipes_of(_outputs),
                build=build,
            script:
                "../scripts/stage.py"


# An artifact that another reading owns: whoever asks for it by its path gets the owner's.
for _path in WORDS:
    if _owned := targets.owned_elsewhere(_path, SHARED):

        rule:
            name:
                _path
            input:
                _owned,

        print(f"{_path} is shared: it is {_owned}", file=sys.stderr)
