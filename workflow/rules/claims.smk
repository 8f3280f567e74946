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
                    subcategory=DEFAULT,
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
            artifacts={r: claimed(_paper, r) for r in STUDIES[_paper].compared},
            inputs={reading: STUDIES[_paper].readings[reading].inputs.plain() for reading in STUDIES[_paper].compared},
            judged=dict(
                known_errata=[erratum.id for erratum in PAPERS[_paper].errata],
                require_reasons=as_committed(_paper),
                left_out=sorted(STUDIES[_paper].readings.keys() - set(STUDIES[_paper].compared)),
                size=SIZE,
            ),
            summaries=list(PAPERS[_paper].summaries),
            code=code("claims.py", *claims_entries(_paper)),
            libraries=libraries("claims.py", *claims_entries(_paper)),
            build=build,
        script:
            "../scripts/claims.py"

    rule:
        name:
            f"{_paper}_counterexamples"
        input:
            sorted(claimed(_paper, DEFAULT).values()),
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
            artifacts={DEFAULT: claimed(_paper, DEFAULT)},
            inputs={DEFAULT: STUDIES[_paper].readings[DEFAULT].inputs.plain()},
            code=code("counterexamples.py", *claims_entries(_paper)),
            libraries=libraries("counterexamples.py", *claims_entries(_paper)),
            build=build,
        script:
            "../scripts/counterexamples.py"


rule all_claims:
    input:
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
        code=code("all_claims.py"),
    script:
        "../scripts/all_claims.py"
