# Verdicts on every printed claim: one job per paper over all its readings, one that turns each verdict by its
# counterexample, then all papers in one file.


rule paper_claims:
    input:
        artifacts=artifacts_of("report/claims/{paper}.json"),
        points="report/points/{paper}.json",
        published=source("data/published/{paper}.yaml"),
        measured=source("data/reference/benchmarks.csv"),
        rerun=if_stale("report/claims/{paper}.json"),
    output:
        claims="report/claims/{paper}.json",
        csv=report("figures/{paper}/claims.csv", category="{paper}"),
        md="figures/{paper}/claims.md",
        picture="figures/{paper}/headline.png",
    log:
        "logs/{paper}/claims.log",
    benchmark:
        "benchmarks/{paper}/claims.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/claims/{paper}.json"),
    script:
        "../scripts/claims.py"


rule counterexamples:
    input:
        artifacts=artifacts_of("report/counterexamples/{paper}.json"),
        claims="report/claims/{paper}.json",
        published=source("data/published/{paper}.yaml"),
        measured=source("data/reference/benchmarks.csv"),
        rerun=if_stale("report/counterexamples/{paper}.json"),
    output:
        "report/counterexamples/{paper}.json",
    log:
        "logs/{paper}/counterexamples.log",
    benchmark:
        "benchmarks/{paper}/counterexamples.tsv"
    priority: priority("counterexamples")
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/counterexamples/{paper}.json"),
    script:
        "../scripts/counterexamples.py"


rule claims:
    input:
        claims=expand("report/claims/{paper}.json", paper=PAPERS),
        counterexamples=expand("report/counterexamples/{paper}.json", paper=PAPERS),
        universes=expand("report/universes/{paper}.json", paper=PAPERS),
        rerun=if_stale("report/claims.json"),
    output:
        "report/claims.json",
    log:
        "logs/claims.log",
    benchmark:
        "benchmarks/claims.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/claims.json"),
    script:
        "../scripts/all_claims.py"
