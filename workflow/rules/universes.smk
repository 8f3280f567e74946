# What decides every claim: a paper under all admissible answers to what is doubted about it. Chunks of universes are
# computed in one process each and gathered in a table, from which claims are judged and pictures drawn.


rule multiverse:
    input:
        expand("report/universes/waves/{paper}.h5", paper=PAPERS),


rule points:
    input:
        unpack(inputs("report/points/{paper}.json")),
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
        made=made("report/points/{paper}.json"),
        project=source("."),
    script:
        "../scripts/points.py"


# Those of a build, or the `whole` design with which a new run begins.
rule universes_chunk:
    input:
        unpack(inputs("report/universes/{whole}{paper}.h5", files=False)),
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
        made=made("report/universes/{whole}{paper}.h5", recorded=False),
        project=source("."),
    script:
        "../scripts/universes_chunk.py"


rule universes:
    input:
        unpack(inputs("report/universes/{whole}{paper}.h5")),
        chunks=universe_chunks,
    output:
        "report/universes/{whole}{paper}.h5",
    log:
        "logs/{paper}/{whole}universes.log",
    benchmark:
        "benchmarks/{paper}/{whole}universes.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/universes/{whole}{paper}.h5"),
    script:
        "../scripts/universes.py"


rule waves:
    input:
        unpack(inputs("report/universes/waves/{paper}.h5", files=False)),
        table="report/universes/whole/{paper}.h5",
    output:
        "report/universes/waves/{paper}.h5",
    log:
        "logs/{paper}/waves.log",
    benchmark:
        "benchmarks/{paper}/waves.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/universes/waves/{paper}.h5", recorded=False),
        project=source("."),
    script:
        "../scripts/waves.py"


# A rule for each paper: its pictures are as many as its headlines.
for _paper in PAPERS:

    rule:
        name:
            f"{_paper}_what_decides"
        input:
            unpack(inputs("report/universes/{paper}.json")),
            table="report/universes/{paper}.h5",
            claims="report/claims/{paper}.json",
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
            made=made("report/universes/{paper}.json"),
            project=source("."),
        script:
            "../scripts/what_decides.py"
