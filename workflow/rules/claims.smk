# Verdicts on every printed claim: one job per paper over all its readings, one that turns each verdict by its
# counterexample, then all papers in one file, and a badge.


rule claims:
    input:
        "report/claims.json",
        "report/badge.json",


for _paper in PAPERS:

    rule:
        name:
            f"{_paper}_claims"
        input:
            cache(_paper),
            changed=unproven(f"report/claims/{_paper}.json"),
            published=source(f"data/published/{_paper}.yaml"),
            measured=[source(BENCHMARKS)] * PAPERS[_paper].measured,
        output:
            **{
                stem: [f"figures/{_paper}/{stem}.csv", f"figures/{_paper}/{stem}.md"]
                for stem in PAPERS[_paper].summaries
            },
            claims=f"report/claims/{_paper}.json",
            table=[
                report(
                    f"figures/{_paper}/claims.csv",
                    caption="../report/claims.rst",
                    category=_paper,
                    subcategory=CORRECTED,
                    labels={"reading": "all", "item": "claims", "kind": "table"},
                ),
                f"figures/{_paper}/claims.md",
            ],
        log:
            f"logs/{_paper}/claims.log",
        benchmark:
            f"benchmarks/{_paper}/claims.tsv"
        conda:
            "../envs/marsedl.yaml"
        params:
            paper=_paper,
            made=made(f"report/claims/{_paper}.json"),
            summaries=list(PAPERS[_paper].summaries),
            build=build,
        script:
            "../scripts/claims.py"

    rule:
        name:
            f"{_paper}_counterexamples"
        input:
            sorted(claimed(_paper, CORRECTED).values()),
            changed=unproven(f"report/counterexamples/{_paper}.json"),
            claims=f"report/claims/{_paper}.json",
            published=source(f"data/published/{_paper}.yaml"),
            measured=[source(BENCHMARKS)] * PAPERS[_paper].measured,
        output:
            f"report/counterexamples/{_paper}.json",
        log:
            f"logs/{_paper}/counterexamples.log",
        benchmark:
            f"benchmarks/{_paper}/counterexamples.tsv"
        conda:
            "../envs/marsedl.yaml"
        params:
            paper=_paper,
            made=made(f"report/counterexamples/{_paper}.json"),
            build=build,
        script:
            "../scripts/counterexamples.py"


rule all_claims:
    input:
        changed=unproven("report/claims.json"),
        claims=[f"report/claims/{paper}.json" for paper in PAPERS],
        counterexamples=[f"report/counterexamples/{paper}.json" for paper in PAPERS],
    output:
        claims="report/claims.json",
        badge="report/badge.json",
    log:
        "logs/claims.log",
    benchmark:
        "benchmarks/claims.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/claims.json"),
        build=build,
    script:
        "../scripts/all_claims.py"
