# What decides every claim: a paper under all admissible answers to what is doubted about it. They are computed
# in one process, or in one for each chunk and one that joins them, to a table from which claims are judged.


# Which a reading may name.
DENSITY_TABLES = [source(path) for path in sorted(Path(ROOT).glob("data/atmosphere/*.csv"))]


rule multiverse:
    input:
        expand("report/universes/waves/{paper}.h5", paper=PAPERS),


rule points:
    input:
        configuration=source("configs/{paper}.yaml"),
        frozen=source("data/reference/inputs.json"),
        published=source("data/published/{paper}.yaml"),
        tables=DENSITY_TABLES,
        measured=source("data/reference/benchmarks.csv"),
        rerun=if_stale("report/points/{paper}.json"),
    output:
        "report/points/{paper}.json",
    log:
        "logs/{paper}/points.log",
    benchmark:
        "benchmarks/{paper}/points.tsv"
    priority: priority("points")
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/points/{paper}.json"),
        project=in_project("."),
    script:
        "../scripts/points.py"


# Those of a build, or the `whole` design with which a new run begins.
rule universes:
    input:
        chunks=chunks_of_universes,
        configuration=source("configs/{paper}.yaml"),
        frozen=source("data/reference/inputs.json"),
        published=source("data/published/{paper}.yaml"),
        tables=DENSITY_TABLES,
        measured=source("data/reference/benchmarks.csv"),
        committed=files_of("report/universes/{whole}{paper}.h5"),
        rerun=if_stale("report/universes/{whole}{paper}.h5"),
    output:
        "report/universes/{whole}{paper}.h5",
    log:
        "logs/{paper}/{whole}universes.log",
    benchmark:
        "benchmarks/{paper}/{whole}universes.tsv"
    priority: priority("universes")
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/universes/{whole}{paper}.h5"),
        project=in_project("."),
    script:
        "../scripts/universes.py"


rule universes_chunk:
    input:
        configuration=source("configs/{paper}.yaml"),
        frozen=source("data/reference/inputs.json"),
        published=source("data/published/{paper}.yaml"),
        tables=DENSITY_TABLES,
        measured=source("data/reference/benchmarks.csv"),
        committed=files_of("report/universes/{whole}{paper}.h5"),
        rerun=if_stale("report/universes/{whole}{paper}.h5"),
    output:
        temp("report/universes/{whole}{paper}.{chunk}of{chunks}.h5"),
    log:
        "logs/{paper}/{whole}universes.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/{paper}/{whole}universes.{chunk}of{chunks}.tsv"
    priority: priority("universes")
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/universes/{whole}{paper}.h5", recorded=False),
        project=in_project("."),
    script:
        "../scripts/universes.py"


rule waves:
    input:
        table="report/universes/whole/{paper}.h5",
        configuration=source("configs/{paper}.yaml"),
        frozen=source("data/reference/inputs.json"),
        published=source("data/published/{paper}.yaml"),
        tables=DENSITY_TABLES,
        measured=source("data/reference/benchmarks.csv"),
    output:
        "report/universes/waves/{paper}.h5",
    log:
        "logs/{paper}/waves.log",
    benchmark:
        "benchmarks/{paper}/waves.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/universes/waves/{paper}.h5", recorded=False),
        project=in_project("."),
    script:
        "../scripts/waves.py"


# A rule for each paper: its pictures are as many as its headlines.
for _paper in PAPERS:

    rule:
        name:
            f"{_paper}_what_decides"
        input:
            table="report/universes/{paper}.h5",
            claims="report/claims/{paper}.json",
            committed=files_of("report/universes/{paper}.json"),
            configuration=source("configs/{paper}.yaml"),
            frozen=source("data/reference/inputs.json"),
            published=source("data/published/{paper}.yaml"),
            tables=DENSITY_TABLES,
            rerun=if_stale("report/universes/{paper}.json"),
        output:
            decided="report/universes/{paper}.json",
            judged=expand("figures/{{paper}}/universes/claims.{suffix}", suffix=("csv", "md")),
            effects=expand("figures/{{paper}}/universes/effects.{suffix}", suffix=("csv", "md")),
            pictures=[f"figures/{{paper}}/{picture}.png" for picture in UNIVERSE_PICTURES[_paper]],
        log:
            "logs/{paper}/what_decides.log",
        benchmark:
            "benchmarks/{paper}/what_decides.tsv"
        wildcard_constraints:
            paper=_paper,
        conda:
            "../envs/marsedl.yaml"
        params:
            given=params_of("report/universes/{paper}.json"),
            project=in_project("."),
        script:
            "../scripts/what_decides.py"
