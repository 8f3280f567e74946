# The stages of all papers. A Monte Carlo case is one job, or one for each of its chunks and one that joins them; cases of
# few trials are flown together, in one job of a reading.


rule artifact:
    input:
        artifacts=artifacts_of("data/cache/{paper}/{reading}/{stage}.h5"),
        rerun=if_stale("data/cache/{paper}/{reading}/{stage}.h5"),
    output:
        "data/cache/{paper}/{reading}/{stage}.h5",
    log:
        "logs/{paper}/{reading}/{stage}.log",
    benchmark:
        "benchmarks/{paper}/{reading}/{stage}.tsv"
    priority: priority("{stage}", SHOWN)
    conda:
        "../envs/marsedl.yaml"
    params:
        given=staged("{stage}", "data/cache/{paper}/{reading}/{stage}.h5"),
    script:
        "../scripts/stage.py"


rule flights:
    input:
        artifacts=artifacts_of("data/cache/{paper}/{reading}/montecarlo.{case}.h5"),
        chunks=chunks_of_flights,
        rerun=if_stale("data/cache/{paper}/{reading}/montecarlo.{case}.h5"),
    output:
        "data/cache/{paper}/{reading}/montecarlo.{case}.h5",
    log:
        "logs/{paper}/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/{paper}/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        paper=f"(?!{FLOWN_TOGETHER or '(?!)'})[^/]+",
    priority: priority(FLIGHTS, SHOWN)
    conda:
        "../envs/marsedl.yaml"
    params:
        given=staged(FLIGHTS, "data/cache/{paper}/{reading}/montecarlo.{case}.h5"),
    script:
        "../scripts/stage.py"


rule chunk:
    input:
        artifacts=artifacts_of("data/cache/{paper}/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
        rerun=if_stale("data/cache/{paper}/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    output:
        temp("data/cache/{paper}/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    log:
        "logs/{paper}/{reading}/montecarlo.{case}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/{paper}/{reading}/montecarlo.{case}.{chunk}of{chunks}.tsv"
    priority: priority(FLIGHTS, SHOWN)
    conda:
        "../envs/marsedl.yaml"
    params:
        given=staged(FLIGHTS, "data/cache/{paper}/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    script:
        "../scripts/stage.py"


# A rule for each set of cases: the files of a job are as many as its cases.
for _number, (_paper, _cases, _readings) in enumerate(TOGETHER):
    _flown = [f"data/cache/{{paper}}/{{reading}}/montecarlo.{case}.h5" for case in _cases]

    rule:
        name:
            f"{_paper}_flights_{_number}"
        input:
            artifacts=artifacts_of(_flown[0]),
            rerun=if_stale(*_flown),
        output:
            _flown,
        log:
            "logs/{paper}/{reading}/flights.log",
        benchmark:
            "benchmarks/{paper}/{reading}/flights.tsv"
        wildcard_constraints:
            paper=_paper,
            reading=_readings,
        priority: priority(FLIGHTS, SHOWN)
        conda:
            "../envs/marsedl.yaml"
        params:
            given=staged(FLIGHTS, *_flown),
        script:
            "../scripts/stage.py"
